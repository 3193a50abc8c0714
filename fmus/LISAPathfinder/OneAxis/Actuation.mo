within LISAPathfinder.OneAxis;
model Actuation "Capacitive actuation along x: authority, hold and true gain"
  extends PartialActuation;
equation
  leak = 0;
  coupling_1 = 0;
  coupling_2 = 0;
  annotation (Documentation(info = "<html>
<p>PartialActuation without other degrees of freedom.</p>
</html>"));
end Actuation;
