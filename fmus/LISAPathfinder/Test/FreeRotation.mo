within LISAPathfinder.Test;
model FreeRotation "Test mass that is seen from a rotating spacecraft"
  extends Icons.Example;
  constant Types.AngularVelocity rate = 1e-4 "Rate of the spacecraft about z";
  constant Types.Length d = 0.2 "Distance of the test mass from the centre along x";
  SixDof.Spacecraft spacecraft(Omega_start = {0, 0, rate}, F_sc = zeros(3), N_sc = zeros(3), s_1 = zeros(3),
    F_1 = zeros(3), N_1 = zeros(3), s_2 = zeros(3), F_2 = zeros(3), N_2 = zeros(3)) "Spacecraft without forces";
  SixDof.TestMass testMass(R = {d, 0, 0}, omega2 = zeros(3), omega2_rot = zeros(3), g = zeros(3), f = zeros(3),
    gamma = zeros(3), nu = zeros(3)) "Free test mass, at rest relative to the spacecraft at first";
equation
  connect(spacecraft.a_O, testMass.a_O);
  connect(spacecraft.Omega, testMass.Omega);
  connect(spacecraft.dOmega, testMass.dOmega);
  assert(abs(testMass.s[1] - d*(cos(rate*time) + rate*time*sin(rate*time) - 1)) <= 1e-4*d*(rate*100)^2,
    "the test mass departs from a straight line in inertial space");
  assert(abs(testMass.s[2] - d*(rate*time*cos(rate*time) - sin(rate*time))) <= 1e-10*d,
    "the test mass is not deflected by the Coriolis force");
  annotation (
    experiment(StopTime = 100, Interval = 0.1),
    Documentation(info = "<html>
<p>In inertial space the test mass moves in a straight line with velocity Omega x R. Seen from the spacecraft the
centrifugal force moves it along x, and the Coriolis force deflects it along -y by d*(rate*time)^3/3.</p>
</html>"));
end FreeRotation;
