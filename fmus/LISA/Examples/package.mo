within LISA;
package Examples "Closed loops to be simulated"
  extends Icons.Package;
  annotation (Documentation(info = "<html>
<p>Open one and simulate it.</p>
</html>"));
end Examples;
