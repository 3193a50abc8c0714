within LISAPathfinder.OneAxis;
model Spacecraft "The spacecraft along x: pushed by its thrusters, and back by what it pushes"
  extends Icons.Body;
  parameter Types.Mass m_sc = 422.7 "Mass of the spacecraft";
  Interfaces.ThrustInput F_thrust "Thrust";
  Interfaces.ThrustInput F_noise "Force noise of thrusters and environment";
  Interfaces.ForceInput F_1 "Force of the spacecraft on test mass 1";
  Interfaces.ForceInput F_2 "Force of the spacecraft on test mass 2";
  Interfaces.AccelerationOutput a_SC "Acceleration of the spacecraft";
equation
  m_sc*a_SC = F_thrust + F_noise - F_1 - F_2;
  annotation (Documentation(info = "<html>
<pre>
  m_sc*a_SC = F_thrust + F_noise - F_1 - F_2
</pre>
<p>F_1 and F_2 are the forces of the spacecraft on the test masses. Default: mass as in the LTPDA parameter files.</p>
</html>"));
end Spacecraft;
