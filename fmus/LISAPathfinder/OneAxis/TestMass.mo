within LISAPathfinder.OneAxis;
model TestMass "One free-floating test mass in its housing, along x"
  extends Icons.Body;
  parameter Types.Mass m_tm = 1.928 "Mass of the test mass";
  parameter Types.Stiffness omega2_0 = -4e-7 "Background stiffness: gravity gradient, sensing bias, charge";
  parameter Types.StiffnessPerForce alpha_x = -320 "Stiffness per unit of force authority";
  parameter Types.StiffnessPerTorque alpha_phi = -26.5e3 "Stiffness per unit of torque authority";
  parameter Types.Force F_max = 0 "Authority of the x force";
  parameter Types.Torque N_max = 0 "Authority of the torque about phi";
  final parameter Types.Stiffness omega2 = omega2_0 + alpha_x*F_max + alpha_phi*N_max
    "Total stiffness, background and authority";
  Interfaces.AccelerationInput g "Stray force per unit mass";
  Interfaces.AccelerationInput f "Applied electrostatic force per unit mass";
  Interfaces.AccelerationInput a_SC "Acceleration of the spacecraft";
  Interfaces.PositionOutput x(start = 0, fixed = true) "Position relative to the housing";
  Interfaces.ForceOutput F "Force of the spacecraft on the test mass";
  Types.Velocity v(start = 0, fixed = true) "Velocity relative to the housing";
equation
  F = m_tm*(g - omega2*x + f);
  der(x) = v;
  der(v) = F/m_tm - a_SC;
  annotation (Documentation(info = "<html>
<pre>
  x'' = F/m_tm - a_SC,   F/m_tm = g - omega2*x + f,   omega2 = omega2_0 + alpha_x*F_max + alpha_phi*N_max
</pre>
<p>A negative omega2 is destabilising. The stiffness grows with the authorities, since the actuation keeps the sum of
the squared voltages constant, Eq. (8) of Phys. Rev. D 97, 122002 (2018).</p>
<p>Defaults: mass as flown; stiffness of the order of the budget given there (gravity gradient, sensing bias,
charge).</p>
</html>"));
end TestMass;
