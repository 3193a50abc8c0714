within LISAPathfinder.Test;
model FreeFall "Test mass without stiffness under a constant acceleration"
  extends Icons.Example;
  constant Types.Acceleration g = 1e-12 "Stray acceleration";
  OneAxis.TestMass testMass(omega2_0 = 0, g = g, f = 0, a_SC = 0) "Free test mass";
equation
  assert(abs(testMass.x - g*time^2/2) <= 1e-12*g*100^2/2, "the test mass departs from x = g*t^2/2");
  annotation (
    experiment(StopTime = 100, Interval = 0.1),
    Documentation(info = "<html>
<p>x = g t^2/2, exact to rounding.</p>
</html>"));
end FreeFall;
