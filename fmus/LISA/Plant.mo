within LISA;
model Plant "Spacecraft, two optical assemblies, and a test mass in each"
  extends Icons.Plant;
  parameter Types.Mass m_sc = 1500 "Mass of the spacecraft";
  parameter Types.Inertia I_xx_sc = 900 "Inertia of the spacecraft about x, assemblies included";
  parameter Types.Inertia I_yy_sc = 900 "Inertia of the spacecraft about y, assemblies included";
  parameter Types.Inertia I_zz_sc = 1200 "Inertia of the spacecraft about z, assemblies included";
  parameter Types.Mass m_tm = 1.928 "Mass of each test mass";
  parameter Types.Inertia I_tm = 6.80e-4 "Inertia of each test mass about any axis";
  parameter Types.Inertia I_mosa = 15 "Inertia of each assembly about its pivot";
  parameter Types.Angle half_opening = Constants.pi/6 "Half of the nominal angle between the assemblies";
  parameter Types.Angle opening = 0 "Direction of assembly 1 beyond its nominal one";
  parameter Types.Length p_x_1 = 0.10 "Location of the pivot of assembly 1 along x";
  parameter Types.Length p_y_1 = 0.25 "Location of the pivot of assembly 1 along y";
  parameter Types.Length p_z_1 = 0 "Location of the pivot of assembly 1 along z";
  parameter Types.Length p_x_2 = 0.10 "Location of the pivot of assembly 2 along x";
  parameter Types.Length p_y_2 = -0.25 "Location of the pivot of assembly 2 along y";
  parameter Types.Length p_z_2 = 0 "Location of the pivot of assembly 2 along z";
  parameter Types.Length rho_x_1 = 0 "Location of housing 1 from the pivot along x_1";
  parameter Types.Length rho_y_1 = 0 "Location of housing 1 from the pivot along y_1";
  parameter Types.Length rho_z_1 = 0 "Location of housing 1 from the pivot along z_1";
  parameter Types.Length rho_x_2 = 0 "Location of housing 2 from the pivot along x_2";
  parameter Types.Length rho_y_2 = 0 "Location of housing 2 from the pivot along y_2";
  parameter Types.Length rho_z_2 = 0 "Location of housing 2 from the pivot along z_2";
  parameter Types.Frequency f_mosa = 0.5 "Natural frequency of the mechanism of each assembly";
  parameter Types.Ratio damping_mosa = 0.7 "Damping ratio of the mechanism of each assembly";
  parameter Types.Time tau_1 = 0.1 "Transport delay of the electrostatic commands on test mass 1";
  parameter Types.Time tau_2 = 0.1 "Transport delay of the electrostatic commands on test mass 2";
  parameter Types.Time tau_sc = 0.25 "Transport delay of the thrust commands";
  parameter Types.Time T_sc = 0.1 "Lag of the thrust";
  parameter Types.Force F_max_1 = 0 "Authority of the force on test mass 1 along x_1";
  parameter Types.Force F_max_2 = 0 "Authority of the force on test mass 2 along x_2";
  parameter Types.Torque N_max_1 = 10.4e-12 "Authority of the torque on test mass 1 about z";
  parameter Types.Torque N_max_2 = 10.4e-12 "Authority of the torque on test mass 2 about z";
  parameter Types.Stiffness omega2_x_1_0 = -3.2e-7 "Background stiffness of test mass 1 along x_1";
  parameter Types.Stiffness omega2_x_2_0 = -2.2e-7 "Background stiffness of test mass 2 along x_2";
  parameter Types.StiffnessPerForce alpha_x_1 = -320 "Stiffness of test mass 1 along x_1 per force authority";
  parameter Types.StiffnessPerForce alpha_x_2 = -320 "Stiffness of test mass 2 along x_2 per force authority";
  parameter Types.StiffnessPerTorque alpha_phi_1 = -26.5e3 "Stiffness of test mass 1 along x_1 per torque authority";
  parameter Types.StiffnessPerTorque alpha_phi_2 = -26.5e3 "Stiffness of test mass 2 along x_2 per torque authority";
  parameter Types.Stiffness omega2_y_1 = -1e-6 "Stiffness of test mass 1 along y_1";
  parameter Types.Stiffness omega2_y_2 = -1e-6 "Stiffness of test mass 2 along y_2";
  parameter Types.Stiffness omega2_xy_1 = 3e-8 "Cross stiffness of x_1 and y_1";
  parameter Types.Stiffness omega2_xy_2 = 3e-8 "Cross stiffness of x_2 and y_2";
  parameter Types.Stiffness omega2_z = -1e-6 "Stiffness of each test mass along z";
  parameter Types.Stiffness omega2_theta = -1.5e-6 "Stiffness of each test mass about x";
  parameter Types.Stiffness omega2_eta = -1.5e-6 "Stiffness of each test mass about y";
  parameter Types.Stiffness omega2_phi = -1.5e-6 "Stiffness of each test mass about z";
  parameter Types.Thrust F_solar_x = 0 "Pressure of sunlight on the spacecraft along x";
  parameter Types.Thrust F_solar_y = 0 "Pressure of sunlight on the spacecraft along y";
  parameter Types.Thrust F_solar_z = 0 "Pressure of sunlight on the spacecraft along z";
  parameter Types.Acceleration gravity_x_1 = 0 "Gravity of the spacecraft at test mass 1 along x_1";
  parameter Types.Acceleration gravity_y_1 = 0 "Gravity of the spacecraft at test mass 1 along y_1";
  parameter Types.Acceleration gravity_z_1 = 0 "Gravity of the spacecraft at test mass 1 along z_1";
  parameter Types.Acceleration gravity_x_2 = 0 "Gravity of the spacecraft at test mass 2 along x_2";
  parameter Types.Acceleration gravity_y_2 = 0 "Gravity of the spacecraft at test mass 2 along y_2";
  parameter Types.Acceleration gravity_z_2 = 0 "Gravity of the spacecraft at test mass 2 along z_2";
  Interfaces.ForceInput F_applied_x_1 "Force on test mass 1 along x_1, before its delay";
  Interfaces.ForceInput F_applied_y_1 "Force on test mass 1 along y_1, before its delay";
  Interfaces.ForceInput F_applied_z_1 "Force on test mass 1 along z_1, before its delay";
  Interfaces.TorqueInput N_applied_theta_1 "Torque on test mass 1 about x_1, before its delay";
  Interfaces.TorqueInput N_applied_eta_1 "Torque on test mass 1 about y_1, before its delay";
  Interfaces.TorqueInput N_applied_phi_1 "Torque on test mass 1 about z_1, before its delay";
  Interfaces.ForceInput F_applied_x_2 "Force on test mass 2 along x_2, before its delay";
  Interfaces.ForceInput F_applied_y_2 "Force on test mass 2 along y_2, before its delay";
  Interfaces.ForceInput F_applied_z_2 "Force on test mass 2 along z_2, before its delay";
  Interfaces.TorqueInput N_applied_theta_2 "Torque on test mass 2 about x_2, before its delay";
  Interfaces.TorqueInput N_applied_eta_2 "Torque on test mass 2 about y_2, before its delay";
  Interfaces.TorqueInput N_applied_phi_2 "Torque on test mass 2 about z_2, before its delay";
  Interfaces.ThrustInput F_x_sc "Commanded thrust along x";
  Interfaces.ThrustInput F_y_sc "Commanded thrust along y";
  Interfaces.ThrustInput F_z_sc "Commanded thrust along z";
  Interfaces.ThrustTorqueInput N_x_sc "Commanded torque of the thrusters about x";
  Interfaces.ThrustTorqueInput N_y_sc "Commanded torque of the thrusters about y";
  Interfaces.ThrustTorqueInput N_z_sc "Commanded torque of the thrusters about z";
  Interfaces.AngleInput mosa_control_1 "Commanded yaw of assembly 1";
  Interfaces.AngleInput mosa_control_2 "Commanded yaw of assembly 2";
  Interfaces.AngleInput n_mosa_1 "Jitter of the mechanism of assembly 1";
  Interfaces.AngleInput n_mosa_2 "Jitter of the mechanism of assembly 2";
  Interfaces.ThrustInput F_noise_x_sc "Force noise on the spacecraft along x";
  Interfaces.ThrustInput F_noise_y_sc "Force noise on the spacecraft along y";
  Interfaces.ThrustInput F_noise_z_sc "Force noise on the spacecraft along z";
  Interfaces.ThrustTorqueInput N_noise_x_sc "Torque noise on the spacecraft about x";
  Interfaces.ThrustTorqueInput N_noise_y_sc "Torque noise on the spacecraft about y";
  Interfaces.ThrustTorqueInput N_noise_z_sc "Torque noise on the spacecraft about z";
  Interfaces.AccelerationInput g_1 "Stray force per unit mass on test mass 1 along x_1";
  Interfaces.AccelerationInput g_y_1 "Stray force per unit mass on test mass 1 along y_1";
  Interfaces.AccelerationInput g_z_1 "Stray force per unit mass on test mass 1 along z_1";
  Interfaces.AngularAccelerationInput gamma_theta_1 "Stray torque per unit inertia on test mass 1 about x_1";
  Interfaces.AngularAccelerationInput gamma_eta_1 "Stray torque per unit inertia on test mass 1 about y_1";
  Interfaces.AngularAccelerationInput gamma_phi_1 "Stray torque per unit inertia on test mass 1 about z_1";
  Interfaces.AccelerationInput g_2 "Stray force per unit mass on test mass 2 along x_2";
  Interfaces.AccelerationInput g_y_2 "Stray force per unit mass on test mass 2 along y_2";
  Interfaces.AccelerationInput g_z_2 "Stray force per unit mass on test mass 2 along z_2";
  Interfaces.AngularAccelerationInput gamma_theta_2 "Stray torque per unit inertia on test mass 2 about x_2";
  Interfaces.AngularAccelerationInput gamma_eta_2 "Stray torque per unit inertia on test mass 2 about y_2";
  Interfaces.AngularAccelerationInput gamma_phi_2 "Stray torque per unit inertia on test mass 2 about z_2";
  Interfaces.PositionOutput x_1 "Position of test mass 1 along x_1, relative to its housing";
  Interfaces.PositionOutput y_1 "Position of test mass 1 along y_1, relative to its housing";
  Interfaces.PositionOutput z_1 "Position of test mass 1 along z_1, relative to its housing";
  Interfaces.AngleOutput theta_1 "Angle of test mass 1 about x_1, relative to its housing";
  Interfaces.AngleOutput eta_1 "Angle of test mass 1 about y_1, relative to its housing";
  Interfaces.AngleOutput phi_1 "Angle of test mass 1 about z_1, relative to its housing";
  Interfaces.PositionOutput x_2 "Position of test mass 2 along x_2, relative to its housing";
  Interfaces.PositionOutput y_2 "Position of test mass 2 along y_2, relative to its housing";
  Interfaces.PositionOutput z_2 "Position of test mass 2 along z_2, relative to its housing";
  Interfaces.AngleOutput theta_2 "Angle of test mass 2 about x_2, relative to its housing";
  Interfaces.AngleOutput eta_2 "Angle of test mass 2 about y_2, relative to its housing";
  Interfaces.AngleOutput phi_2 "Angle of test mass 2 about z_2, relative to its housing";
  Interfaces.AngleOutput yaw_1 "Yaw of assembly 1, from its nominal direction";
  Interfaces.AngleOutput yaw_2 "Yaw of assembly 2, from its nominal direction";
  Interfaces.AngleOutput Theta "Attitude of the spacecraft about x, in inertial space";
  Interfaces.AngleOutput Eta "Attitude of the spacecraft about y, in inertial space";
  Interfaces.AngleOutput Phi "Attitude of the spacecraft about z, in inertial space";
  final parameter Types.Length p_1[3] = {p_x_1, p_y_1, p_z_1} "Location of the pivot of assembly 1";
  final parameter Types.Length p_2[3] = {p_x_2, p_y_2, p_z_2} "Location of the pivot of assembly 2";
  Assembly assembly_1(m_tm = m_tm, I_tm = I_tm, I_mosa = I_mosa, direction = half_opening + opening, p = p_1,
    rho = {rho_x_1, rho_y_1, rho_z_1}, omega2_xy = omega2_xy_1,
    omega2 = {omega2_x_1_0 + alpha_x_1*F_max_1 + alpha_phi_1*N_max_1, omega2_y_1, omega2_z},
    omega2_rot = {omega2_theta, omega2_eta, omega2_phi}, f_mosa = f_mosa, damping_mosa = damping_mosa)
      "Assembly 1 and its test mass";
  Assembly assembly_2(m_tm = m_tm, I_tm = I_tm, I_mosa = I_mosa, direction = -half_opening, p = p_2,
    rho = {rho_x_2, rho_y_2, rho_z_2}, omega2_xy = omega2_xy_2,
    omega2 = {omega2_x_2_0 + alpha_x_2*F_max_2 + alpha_phi_2*N_max_2, omega2_y_2, omega2_z},
    omega2_rot = {omega2_theta, omega2_eta, omega2_phi}, f_mosa = f_mosa, damping_mosa = damping_mosa)
      "Assembly 2 and its test mass";
  SixDof.Spacecraft spacecraft(m_sc = m_sc, I_sc = {I_xx_sc, I_yy_sc, I_zz_sc}, R_1 = p_1, R_2 = p_2) "The spacecraft";
  OneAxis.Thruster thruster[3](each tau_sc = tau_sc, each T_sc = T_sc) "The thrusters along x, y, z";
  SixDof.TorqueThruster torqueThruster[3](each tau_sc = tau_sc, each T_sc = T_sc) "The thrusters about x, y, z";
equation
  // A force that switches between two samples cannot cross an FMU boundary: the delays act here.
  assembly_1.F_applied = {delay(F_applied_x_1, tau_1), delay(F_applied_y_1, tau_1),
    delay(F_applied_z_1, tau_1)};
  assembly_1.N_applied = {delay(N_applied_theta_1, tau_1), delay(N_applied_eta_1, tau_1),
    delay(N_applied_phi_1, tau_1)};
  assembly_1.g = {g_1 + gravity_x_1, g_y_1 + gravity_y_1, g_z_1 + gravity_z_1};
  assembly_1.gamma = {gamma_theta_1, gamma_eta_1, gamma_phi_1};
  assembly_1.command = mosa_control_1 + n_mosa_1;
  assembly_2.F_applied = {delay(F_applied_x_2, tau_2), delay(F_applied_y_2, tau_2),
    delay(F_applied_z_2, tau_2)};
  assembly_2.N_applied = {delay(N_applied_theta_2, tau_2), delay(N_applied_eta_2, tau_2),
    delay(N_applied_phi_2, tau_2)};
  assembly_2.g = {g_2 + gravity_x_2, g_y_2 + gravity_y_2, g_z_2 + gravity_z_2};
  assembly_2.gamma = {gamma_theta_2, gamma_eta_2, gamma_phi_2};
  assembly_2.command = mosa_control_2 + n_mosa_2;
  connect(spacecraft.a_O, assembly_1.a_O);
  connect(spacecraft.a_O, assembly_2.a_O);
  connect(spacecraft.Omega, assembly_1.Omega);
  connect(spacecraft.Omega, assembly_2.Omega);
  connect(spacecraft.dOmega, assembly_1.dOmega);
  connect(spacecraft.dOmega, assembly_2.dOmega);
  thruster.F = {F_x_sc, F_y_sc, F_z_sc};
  torqueThruster.F = {N_x_sc, N_y_sc, N_z_sc};
  spacecraft.F_sc = thruster.F_thrust + {F_noise_x_sc + F_solar_x, F_noise_y_sc + F_solar_y,
    F_noise_z_sc + F_solar_z};
  spacecraft.N_sc = torqueThruster.F_thrust + {N_noise_x_sc, N_noise_y_sc, N_noise_z_sc};
  connect(assembly_1.r, spacecraft.s_1);
  connect(assembly_2.r, spacecraft.s_2);
  connect(assembly_1.F, spacecraft.F_1);
  connect(assembly_2.F, spacecraft.F_2);
  connect(assembly_1.N, spacecraft.N_1);
  connect(assembly_2.N, spacecraft.N_2);
  {x_1, y_1, z_1} = assembly_1.testMass.s;
  {theta_1, eta_1, phi_1} = assembly_1.testMass.angle;
  yaw_1 = assembly_1.yaw;
  {x_2, y_2, z_2} = assembly_2.testMass.s;
  {theta_2, eta_2, phi_2} = assembly_2.testMass.angle;
  yaw_2 = assembly_2.yaw;
  {Theta, Eta, Phi} = spacecraft.attitude;
  annotation (Documentation(info = "<html>
<pre>
  m_sc*a_O    = F_sc - F_1 - F_2
  I_sc*dOmega = N_sc - N_1 - N_2 - (p_1 + r_1) x F_1 - (p_2 + r_2) x F_2 - Omega x (I_sc*Omega)
</pre>
<p>LISAPathfinder.SixDof.Spacecraft, with the pivots in the place of the housings, its thrusters, and two Assembly,
whose F_j, N_j and r_j are in axes of the spacecraft. Electrostatic commands act after their transport delays, here and
not in the actuation: a force that switches between two samples cannot cross the boundary of an FMU.</p>
<p>Sensitive axes, for small angles and with r_j = p_j + rho_j in axes of the spacecraft:</p>
<pre>
  x_j'' = g_j - omega2_x_j*x_j - omega2_xy_j*y_j + F_applied_x_j/m_tm - u_j.(a_O + dOmega x r_j)
  u_j   = (cos a_j, sin a_j, 0)                        a_1 = half_opening + opening, a_2 = -half_opening
  omega2_x_j = omega2_x_j_0 + alpha_x_j*F_max_j + alpha_phi_j*N_max_j
</pre>
<p>Voltages that are ready to pull F_max_j along x_j and turn by N_max_j about z add to the stiffness along x_j (Eq. (8) of
Phys. Rev. D 97, 122002). Sunlight and the gravity of the spacecraft are constant.</p>
<p>Defaults: test masses as flown on LISA Pathfinder. Mass, inertia, geometry and mechanism are a choice, as are
stiffness (of the order of LISA Pathfinder; per authority what its electrodes were predicted to have), delays and lag of
the thrust (those of LISA Pathfinder). No constant forces.</p>
</html>"));
end Plant;
