within LISAPathfinder.OneAxis;
model Plant "Spacecraft and two test masses along x, the three-body plant"
  extends Icons.Plant;
  parameter Types.Mass m_sc = 422.7 "Mass of the spacecraft";
  parameter Types.Mass m_tm = 1.928 "Mass of each test mass";
  parameter Types.Time tau_1 = 0.08863 "Transport delay of f_applied_1";
  parameter Types.Time tau_2 = 0.12261 "Transport delay of f_applied_2";
  parameter Types.Stiffness omega2_1_0(max = 0) = -3.99e-7 "Background stiffness of test mass 1";
  parameter Types.Stiffness omega2_2_0(max = 0) = -4.19e-7 "Background stiffness of test mass 2";
  parameter Types.StiffnessPerForce alpha_x_1(max = 0) = -345 "Stiffness of test mass 1 per force authority";
  parameter Types.StiffnessPerForce alpha_x_2(max = 0) = -317 "Stiffness of test mass 2 per force authority";
  parameter Types.StiffnessPerTorque alpha_phi_1(max = 0) = -28.2e3 "Stiffness of test mass 1 per torque authority";
  parameter Types.StiffnessPerTorque alpha_phi_2(max = 0) = -27.4e3 "Stiffness of test mass 2 per torque authority";
  parameter Types.Force F_max_1 = 0 "Authority of the x force on test mass 1";
  parameter Types.Force F_max_2 = 2200e-12 "Authority of the x force on test mass 2";
  parameter Types.Torque N_max_1 = 10.4e-12 "Authority of the phi torque on test mass 1";
  parameter Types.Torque N_max_2 = 10.4e-12 "Authority of the phi torque on test mass 2";
  parameter Types.Time tau_sc = 0.25 "Transport delay of the thrust command";
  parameter Types.Time T_sc = 0.1 "Lag of the thrust";
  Interfaces.AccelerationInput f_applied_1 "Electrostatic force per unit mass on test mass 1, before its delay";
  Interfaces.AccelerationInput f_applied_2 "Electrostatic force per unit mass on test mass 2, before its delay";
  Interfaces.ThrustInput F_x_sc "Commanded thrust";
  Interfaces.AccelerationInput g_1 "Stray force per unit mass on test mass 1";
  Interfaces.AccelerationInput g_2 "Stray force per unit mass on test mass 2";
  Interfaces.ThrustInput F_noise_x_sc "Force noise on the spacecraft";
  Interfaces.PositionOutput x_1 "Position of test mass 1 relative to the spacecraft";
  Interfaces.PositionOutput x_2 "Position of test mass 2 relative to the spacecraft";
  Interfaces.AccelerationOutput a_SC "Acceleration of the spacecraft";
  TestMass testMass_1(m_tm = m_tm, omega2_0 = omega2_1_0, alpha_x = alpha_x_1, alpha_phi = alpha_phi_1,
    F_max = F_max_1, N_max = N_max_1) "Test mass 1, the drag-free reference";
  TestMass testMass_2(m_tm = m_tm, omega2_0 = omega2_2_0, alpha_x = alpha_x_2, alpha_phi = alpha_phi_2,
    F_max = F_max_2, N_max = N_max_2) "Test mass 2, electrostatically suspended";
  Spacecraft spacecraft(m_sc = m_sc) "The spacecraft";
  Thruster thruster(tau_sc = tau_sc, T_sc = T_sc) "The thrusters";
equation
  // A force that switches between two samples cannot cross an FMU boundary: the delay acts here.
  testMass_1.f = delay(f_applied_1, tau_1);
  testMass_2.f = delay(f_applied_2, tau_2);
  connect(g_1, testMass_1.g);
  connect(g_2, testMass_2.g);
  connect(spacecraft.a_SC, testMass_1.a_SC);
  connect(spacecraft.a_SC, testMass_2.a_SC);
  connect(F_x_sc, thruster.F);
  connect(thruster.F_thrust, spacecraft.F_thrust);
  connect(F_noise_x_sc, spacecraft.F_noise);
  connect(testMass_1.F, spacecraft.F_1);
  connect(testMass_2.F, spacecraft.F_2);
  connect(testMass_1.x, x_1);
  connect(testMass_2.x, x_2);
  connect(spacecraft.a_SC, a_SC);
  annotation (Documentation(info = "<html>
<p>Two TestMass, a Spacecraft and a Thruster. The electrostatic forces act after their transport delays tau_1 and
tau_2, here and not in the actuation: a force that switches between two samples cannot cross the boundary of an
FMU.</p>
<p>tau_1 and tau_2 are pure transport delays. The effective delays of the estimation, C_j/lambda_j, add half a sample of
the hold. Defaults: joint fit in Phys. Rev. D 97, 122002 (2018), less 0.05 s.</p>
</html>"));
end Plant;
