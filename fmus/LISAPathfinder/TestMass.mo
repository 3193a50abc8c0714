within LISAPathfinder;
model TestMass "One free-floating test mass in its housing, along x"
  parameter Types.Mass m_tm = 1.928 "Mass of the test mass";
  parameter Types.Stiffness omega2_0 = -4e-7 "Background stiffness: gravity gradient, sensing bias, charge";
  parameter Types.StiffnessPerForce alpha_x = -320 "Stiffness per unit of force authority";
  parameter Types.StiffnessPerTorque alpha_phi = -26.5e3 "Stiffness per unit of torque authority";
  parameter Types.Force F_max = 0 "Authority of the x force";
  parameter Types.Torque N_max = 0 "Authority of the torque about phi";
  final parameter Types.Stiffness omega2 = omega2_0 + alpha_x*F_max + alpha_phi*N_max
    "Total stiffness, eq. stiff_model";
  input Types.Acceleration g "Stray force per unit mass";
  input Types.Acceleration f "Applied electrostatic force per unit mass";
  input Types.Acceleration a_SC "Acceleration of the spacecraft";
  output Types.Position x(start = 0, fixed = true) "Position relative to the housing";
  output Types.Force F "Force of the spacecraft on the test mass";
  Types.Velocity v(start = 0, fixed = true) "Velocity relative to the housing";
equation
  F = m_tm*(g - omega2*x + f);
  der(x) = v;
  der(v) = F/m_tm - a_SC;
end TestMass;
