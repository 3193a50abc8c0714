within LISAPathfinder.SixDof;
model Plant "Spacecraft and two test masses, six degrees of freedom each, in the frame of the spacecraft"
  extends Icons.Plant;
  parameter Types.Mass m_sc = 422.7 "Mass of the spacecraft";
  parameter Types.Inertia I_xx_sc = 202.5 "Inertia of the spacecraft about x";
  parameter Types.Inertia I_yy_sc = 209.7 "Inertia of the spacecraft about y";
  parameter Types.Inertia I_zz_sc = 191.7 "Inertia of the spacecraft about z";
  parameter Types.Mass m_tm = 1.928 "Mass of each test mass";
  parameter Types.Inertia I_tm = 6.80e-4 "Inertia of each test mass about any axis";
  parameter Types.Length d = 0.376 "Distance of the test masses along x";
  parameter Types.Length delta_y = 0 "Offset of test mass 2 against test mass 1 along y";
  parameter Types.Length delta_z = 0 "Offset of test mass 2 against test mass 1 along z";
  parameter Types.Time tau_1 = 0.08863 "Transport delay of f_applied_1";
  parameter Types.Time tau_2 = 0.12261 "Transport delay of f_applied_2";
  parameter Types.Time tau_es = 0.1 "Transport delay of all other electrostatic commands";
  parameter Types.Time tau_sc = 0.25 "Transport delay of the thrust commands";
  parameter Types.Time T_sc = 0.1 "Lag of the thrust";
  parameter Types.Stiffness omega2_1_0(max = 0) = -3.99e-7 "Background stiffness of test mass 1 along x";
  parameter Types.Stiffness omega2_2_0(max = 0) = -4.19e-7 "Background stiffness of test mass 2 along x";
  parameter Types.StiffnessPerForce alpha_x_1(max = 0) = -345 "Stiffness of test mass 1 per force authority";
  parameter Types.StiffnessPerForce alpha_x_2(max = 0) = -317 "Stiffness of test mass 2 per force authority";
  parameter Types.StiffnessPerTorque alpha_phi_1(max = 0) = -28.2e3 "Stiffness of test mass 1 per torque authority";
  parameter Types.StiffnessPerTorque alpha_phi_2(max = 0) = -27.4e3 "Stiffness of test mass 2 per torque authority";
  parameter Types.Force F_max_1 = 0 "Authority of the x force on test mass 1";
  parameter Types.Force F_max_2 = 2200e-12 "Authority of the x force on test mass 2";
  parameter Types.Torque N_max_1 = 10.4e-12 "Authority of the torque on test mass 1 about z";
  parameter Types.Torque N_max_2 = 10.4e-12 "Authority of the torque on test mass 2 about z";
  parameter Types.Stiffness omega2_y = -8e-7 "Stiffness of each test mass along y";
  parameter Types.Stiffness omega2_z = -8e-7 "Stiffness of each test mass along z";
  parameter Types.Stiffness omega2_theta = -1.5e-6 "Stiffness of each test mass about x";
  parameter Types.Stiffness omega2_eta = -1.5e-6 "Stiffness of a test mass about y, mean of both";
  parameter Types.Stiffness omega2_phi = -1.5e-6 "Stiffness of a test mass about z, mean of both";
  parameter Types.Stiffness domega2_eta_12 = 0 "Stiffness about y of test mass 2 less that of test mass 1";
  parameter Types.Stiffness domega2_phi_12 = 0 "Stiffness about z of test mass 2 less that of test mass 1";
  parameter Types.Stiffness b_5 = 0 "Force on test mass 2 along x per mean of y_1 and y_2";
  parameter Types.Stiffness b_6 = 0 "Force on test mass 2 along x per mean of z_1 and z_2";
  parameter Types.AngularVelocity Omega_theta_start = 0 "Rate about x at the start";
  parameter Types.AngularVelocity Omega_eta_start = 0 "Rate about y at the start";
  parameter Types.AngularVelocity Omega_phi_start = 0 "Rate about z at the start";
  Interfaces.AccelerationInput f_applied_1 "x force per unit mass on test mass 1, before its delay";
  Interfaces.AccelerationInput f_applied_2 "x force per unit mass on test mass 2, before its delay";
  Interfaces.ForceInput F_applied_y_1 "Force on test mass 1 along y, before its delay";
  Interfaces.ForceInput F_applied_z_1 "Force on test mass 1 along z, before its delay";
  Interfaces.ForceInput F_applied_y_2 "Force on test mass 2 along y, before its delay";
  Interfaces.ForceInput F_applied_z_2 "Force on test mass 2 along z, before its delay";
  Interfaces.TorqueInput N_applied_theta_1 "Torque on test mass 1 about x, before its delay";
  Interfaces.TorqueInput N_applied_eta_1 "Torque on test mass 1 about y, before its delay";
  Interfaces.TorqueInput N_applied_phi_1 "Torque on test mass 1 about z, before its delay";
  Interfaces.TorqueInput N_applied_theta_2 "Torque on test mass 2 about x, before its delay";
  Interfaces.TorqueInput N_applied_eta_2 "Torque on test mass 2 about y, before its delay";
  Interfaces.TorqueInput N_applied_phi_2 "Torque on test mass 2 about z, before its delay";
  Interfaces.ThrustInput F_x_sc "Commanded thrust along x";
  Interfaces.ThrustInput F_y_sc "Commanded thrust along y";
  Interfaces.ThrustInput F_z_sc "Commanded thrust along z";
  Interfaces.ThrustTorqueInput N_x_sc "Commanded torque of the thrusters about x";
  Interfaces.ThrustTorqueInput N_y_sc "Commanded torque of the thrusters about y";
  Interfaces.ThrustTorqueInput N_z_sc "Commanded torque of the thrusters about z";
  Interfaces.ThrustInput F_noise_x_sc "Force noise on the spacecraft along x";
  Interfaces.ThrustInput F_noise_y_sc "Force noise on the spacecraft along y";
  Interfaces.ThrustInput F_noise_z_sc "Force noise on the spacecraft along z";
  Interfaces.ThrustTorqueInput N_noise_x_sc "Torque noise on the spacecraft about x";
  Interfaces.ThrustTorqueInput N_noise_y_sc "Torque noise on the spacecraft about y";
  Interfaces.ThrustTorqueInput N_noise_z_sc "Torque noise on the spacecraft about z";
  Interfaces.AccelerationInput g_1 "Stray force per unit mass on test mass 1 along x";
  Interfaces.AccelerationInput g_y_1 "Stray force per unit mass on test mass 1 along y";
  Interfaces.AccelerationInput g_z_1 "Stray force per unit mass on test mass 1 along z";
  Interfaces.AccelerationInput g_2 "Stray force per unit mass on test mass 2 along x";
  Interfaces.AccelerationInput g_y_2 "Stray force per unit mass on test mass 2 along y";
  Interfaces.AccelerationInput g_z_2 "Stray force per unit mass on test mass 2 along z";
  Interfaces.AngularAccelerationInput gamma_theta_1 "Stray torque per unit inertia on test mass 1 about x";
  Interfaces.AngularAccelerationInput gamma_eta_1 "Stray torque per unit inertia on test mass 1 about y";
  Interfaces.AngularAccelerationInput gamma_phi_1 "Stray torque per unit inertia on test mass 1 about z";
  Interfaces.AngularAccelerationInput gamma_theta_2 "Stray torque per unit inertia on test mass 2 about x";
  Interfaces.AngularAccelerationInput gamma_eta_2 "Stray torque per unit inertia on test mass 2 about y";
  Interfaces.AngularAccelerationInput gamma_phi_2 "Stray torque per unit inertia on test mass 2 about z";
  Interfaces.PositionOutput x_1 "Position of test mass 1 along x, relative to the spacecraft";
  Interfaces.PositionOutput y_1 "Position of test mass 1 along y, relative to the spacecraft";
  Interfaces.PositionOutput z_1 "Position of test mass 1 along z, relative to the spacecraft";
  Interfaces.AngleOutput theta_1 "Angle of test mass 1 about x, relative to the spacecraft";
  Interfaces.AngleOutput eta_1 "Angle of test mass 1 about y, relative to the spacecraft";
  Interfaces.AngleOutput phi_1 "Angle of test mass 1 about z, relative to the spacecraft";
  Interfaces.PositionOutput x_2 "Position of test mass 2 along x, relative to the spacecraft";
  Interfaces.PositionOutput y_2 "Position of test mass 2 along y, relative to the spacecraft";
  Interfaces.PositionOutput z_2 "Position of test mass 2 along z, relative to the spacecraft";
  Interfaces.AngleOutput theta_2 "Angle of test mass 2 about x, relative to the spacecraft";
  Interfaces.AngleOutput eta_2 "Angle of test mass 2 about y, relative to the spacecraft";
  Interfaces.AngleOutput phi_2 "Angle of test mass 2 about z, relative to the spacecraft";
  Interfaces.AngleOutput Theta "Attitude of the spacecraft about x, with respect to J2000";
  Interfaces.AngleOutput Eta "Attitude of the spacecraft about y, with respect to J2000";
  Interfaces.AngleOutput Phi "Attitude of the spacecraft about z, with respect to J2000";
  Interfaces.AngularVelocityOutput Omega_theta "Rate of the spacecraft about x, with respect to J2000";
  Interfaces.AngularVelocityOutput Omega_eta "Rate of the spacecraft about y, with respect to J2000";
  Interfaces.AngularVelocityOutput Omega_phi "Rate of the spacecraft about z, with respect to J2000";
  Interfaces.AccelerationOutput a_x_sc "Acceleration of the centre of the spacecraft along x";
  Interfaces.AccelerationOutput a_y_sc "Acceleration of the centre of the spacecraft along y";
  Interfaces.AccelerationOutput a_z_sc "Acceleration of the centre of the spacecraft along z";
  final parameter Types.Length R_2[3] = {d, delta_y, delta_z}/2 "Location of the housing of test mass 2";
  final parameter Types.Length R_1[3] = -R_2 "Location of the housing of test mass 1";
  TestMass testMass_1(m_tm = m_tm, I_tm = I_tm, R = R_1,
    omega2 = {omega2_1_0 + alpha_x_1*F_max_1 + alpha_phi_1*N_max_1, omega2_y, omega2_z},
    omega2_rot = {omega2_theta, omega2_eta - domega2_eta_12/2, omega2_phi - domega2_phi_12/2})
      "Test mass 1, with the stiffness of its authority along x";
  TestMass testMass_2(m_tm = m_tm, I_tm = I_tm, R = R_2,
    omega2 = {omega2_2_0 + alpha_x_2*F_max_2 + alpha_phi_2*N_max_2, omega2_y, omega2_z},
    omega2_rot = {omega2_theta, omega2_eta + domega2_eta_12/2, omega2_phi + domega2_phi_12/2}) "Test mass 2";
  Spacecraft spacecraft(m_sc = m_sc, I_sc = {I_xx_sc, I_yy_sc, I_zz_sc}, R_1 = R_1, R_2 = R_2,
    Omega_start = {Omega_theta_start, Omega_eta_start, Omega_phi_start}) "The spacecraft";
  OneAxis.Thruster thruster[3](each tau_sc = tau_sc, each T_sc = T_sc) "The thrusters along x, y, z";
  TorqueThruster torqueThruster[3](each tau_sc = tau_sc, each T_sc = T_sc) "The thrusters about x, y, z";
equation
  // A force that switches between two samples cannot cross an FMU boundary: the delays act here.
  testMass_1.f = {delay(f_applied_1, tau_1),
    delay(F_applied_y_1, tau_es)/m_tm, delay(F_applied_z_1, tau_es)/m_tm};
  testMass_2.f = {delay(f_applied_2, tau_2),
    delay(F_applied_y_2, tau_es)/m_tm, delay(F_applied_z_2, tau_es)/m_tm};
  testMass_1.nu = {delay(N_applied_theta_1, tau_es), delay(N_applied_eta_1, tau_es),
    delay(N_applied_phi_1, tau_es)}/I_tm;
  testMass_2.nu = {delay(N_applied_theta_2, tau_es), delay(N_applied_eta_2, tau_es),
    delay(N_applied_phi_2, tau_es)}/I_tm;
  testMass_1.g = {g_1, g_y_1, g_z_1};
  testMass_2.g = {g_2 - b_5*(y_1 + y_2)/2 - b_6*(z_1 + z_2)/2, g_y_2, g_z_2};
  testMass_1.gamma = {gamma_theta_1, gamma_eta_1, gamma_phi_1};
  testMass_2.gamma = {gamma_theta_2, gamma_eta_2, gamma_phi_2};
  connect(spacecraft.a_O, testMass_1.a_O);
  connect(spacecraft.a_O, testMass_2.a_O);
  connect(spacecraft.Omega, testMass_1.Omega);
  connect(spacecraft.Omega, testMass_2.Omega);
  connect(spacecraft.dOmega, testMass_1.dOmega);
  connect(spacecraft.dOmega, testMass_2.dOmega);
  thruster.F = {F_x_sc, F_y_sc, F_z_sc};
  torqueThruster.F = {N_x_sc, N_y_sc, N_z_sc};
  spacecraft.F_sc = thruster.F_thrust + {F_noise_x_sc, F_noise_y_sc, F_noise_z_sc};
  spacecraft.N_sc = torqueThruster.F_thrust + {N_noise_x_sc, N_noise_y_sc, N_noise_z_sc};
  connect(testMass_1.s, spacecraft.s_1);
  connect(testMass_2.s, spacecraft.s_2);
  connect(testMass_1.F, spacecraft.F_1);
  connect(testMass_2.F, spacecraft.F_2);
  connect(testMass_1.N, spacecraft.N_1);
  connect(testMass_2.N, spacecraft.N_2);
  {x_1, y_1, z_1} = testMass_1.s;
  {x_2, y_2, z_2} = testMass_2.s;
  {theta_1, eta_1, phi_1} = testMass_1.angle;
  {theta_2, eta_2, phi_2} = testMass_2.angle;
  {Theta, Eta, Phi} = spacecraft.attitude;
  {Omega_theta, Omega_eta, Omega_phi} = spacecraft.Omega;
  {a_x_sc, a_y_sc, a_z_sc} = spacecraft.a_O;
  annotation (Documentation(info = "<html>
<p>Two TestMass and a Spacecraft with three thrusters for forces and three for torques. The electrostatic forces act
after their transport delays, here and not in the actuation: a force that switches between two samples cannot cross the
boundary of an FMU. tau_1 and tau_2 are pure transport delays, as in OneAxis.Plant.</p>
<p>b_5 and b_6 are the stiffness of test mass 2 along x to the mean motion along y and z, Eq. (3) of
Phys. Rev. D 97, 122002 (2018).</p>
<p>Defaults along x: joint fit given there, less half a sample of the delays; beyond x a choice.</p>
</html>"));
end Plant;
