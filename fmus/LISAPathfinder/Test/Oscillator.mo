within LISAPathfinder.Test;
model Oscillator "Test mass with a restoring stiffness"
  extends Icons.Example;
  constant Types.Stiffness omega2 = 1e-2 "Stiffness";
  constant Types.Position x_0 = 1e-9 "Initial displacement";
  OneAxis.TestMass testMass(omega2_0 = omega2, x(start = x_0), g = 0, f = 0, a_SC = 0) "Test mass on a spring";
equation
  assert(abs(testMass.x - x_0*cos(sqrt(omega2)*time)) <= 1e-11*x_0, "the test mass departs from its oscillation");
  annotation (
    experiment(StopTime = 100, Interval = 0.1),
    Documentation(info = "<html>
<p>x = x_0 cos(omega t), exact to rounding.</p>
</html>"));
end Oscillator;
