within LISAPathfinder;
package Controllers "Sampled control laws"
  extends Icons.Package;
  annotation (Documentation(info = "<html>
<p>Laws of one error each. The controllers of OneAxis and SixDof combine them.</p>
</html>"));
end Controllers;
