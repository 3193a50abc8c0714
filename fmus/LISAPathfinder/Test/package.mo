within LISAPathfinder;
package Test "Models with assertions"
  extends Icons.Package;
  annotation (Documentation(info = "<html>
<p>Each compares a model with its solution and stops with an error where they differ.</p>
</html>"));
end Test;
