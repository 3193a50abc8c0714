within LISAPathfinder;
model WholeActuation "Capacitive forces and torques on both test masses: authority, hold, true gain, cross-talk"
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Mass m_tm = 1.928 "Mass of each test mass";
  parameter Real lambda_1(unit = "1") = 1.0748 "True over commanded force on test mass 1";
  parameter Real lambda_2(unit = "1") = 1.0776 "True over commanded force on test mass 2";
  parameter Real lambda_N(unit = "1") = 1 "True over commanded torque on the test masses";
  parameter Types.Force F_max_1 = 0 "Authority of the x force on test mass 1";
  parameter Types.Force F_max_2 = 2200e-12 "Authority of the x force on test mass 2";
  parameter Types.Force F_max_yz = 50e-12 "Authority of the forces along y and z";
  parameter Types.Torque N_max_1 = 10.4e-12 "Authority of the torque on test mass 1 about z";
  parameter Types.Torque N_max_2 = 10.4e-12 "Authority of the torque on test mass 2 about z";
  parameter Types.Torque N_max_theta = 10.4e-12 "Authority of the torques about x";
  parameter Types.Torque N_max_eta = 10.4e-12 "Authority of the torques about y";
  parameter Types.Length arm = 0.011 "Arm of an electrode about the middle of its face";
  parameter Real lambda_bend_1(unit = "1") = 0 "Relative growth of lambda_1 at the force F_ref";
  parameter Real lambda_bend_2(unit = "1") = 0 "Relative growth of lambda_2 at the force F_ref";
  parameter Types.Force F_ref = 1e-9 "Force that lambda_bend_1 and lambda_bend_2 refer to";
  parameter Types.Acceleration f_x_2_start = 0 "Command on test mass 2 before the first sample";
  parameter Real leak_phi_1(unit = "m-1") = 0
    "x force commanded on test mass 1 per torque about z, by imperfectly digitised waveforms";
  parameter Real kappa_phi(unit = "m-1") = 0 "x force on test mass 2 per torque about z that no command shows";
  parameter Real kappa_eta(unit = "m-1") = 0 "x force on test mass 2 per torque about y that no command shows";
  final parameter Types.Acceleration balance_1 = (F_max_1 + N_max_1/arm)/m_tm "Pull of all electrodes on test mass 1";
  final parameter Types.Acceleration balance_2 = (F_max_2 + N_max_2/arm)/m_tm "Pull of all electrodes on test mass 2";
  final parameter Real bend_1(unit = "m-1.s2") = lambda_bend_1*m_tm/F_ref "Relative growth of lambda_1 with the command";
  final parameter Real bend_2(unit = "m-1.s2") = lambda_bend_2*m_tm/F_ref "Relative growth of lambda_2 with the command";
  input Types.Acceleration f_control_2 "Force per unit mass that the suspension control asks for";
  input Types.Force F_control_y_1 "Force that the attitude control asks for on test mass 1 along y";
  input Types.Force F_control_z_1 "Force that the attitude control asks for on test mass 1 along z";
  input Types.Force F_control_y_2 "Force that the attitude control asks for on test mass 2 along y";
  input Types.Force F_control_z_2 "Force that the attitude control asks for on test mass 2 along z";
  input Types.Torque N_control_theta_1 "Torque that the control asks for on test mass 1 about x";
  input Types.Torque N_control_eta_1 "Torque that the control asks for on test mass 1 about y";
  input Types.Torque N_control_phi_1 "Torque that the control asks for on test mass 1 about z";
  input Types.Torque N_control_theta_2 "Torque that the control asks for on test mass 2 about x";
  input Types.Torque N_control_eta_2 "Torque that the control asks for on test mass 2 about y";
  input Types.Torque N_control_phi_2 "Torque that the control asks for on test mass 2 about z";
  input Types.Force F_x_1 "Injected force command on test mass 1";
  input Types.Force F_x_2 "Injected force command on test mass 2";
  input Types.Acceleration f_x_1_jitter "Noise of imperfectly digitised torque waveforms in f_x_1";
  input Real gain_1(unit = "1") "Relative change of lambda_1";
  input Real gain_2(unit = "1") "Relative change of lambda_2";
  input Real e_x_1(unit = "1") "Relative voltage noise between the electrodes at the two sides of test mass 1";
  input Real e_x_2(unit = "1") "Relative voltage noise between the electrodes at the two sides of test mass 2";
  input Real e_N_1(unit = "1") "Relative voltage noise between the electrodes at the two ends of test mass 1";
  input Real e_N_2(unit = "1") "Relative voltage noise between the electrodes at the two ends of test mass 2";
  discrete output Types.Acceleration f_x_1(start = 0, fixed = true) "Commanded force per unit mass on test mass 1";
  discrete output Types.Acceleration f_x_2(start = f_x_2_start, fixed = true)
    "Commanded force per unit mass on test mass 2";
  discrete output Types.Force F_y_1(start = 0, fixed = true) "Commanded force on test mass 1 along y";
  discrete output Types.Force F_z_1(start = 0, fixed = true) "Commanded force on test mass 1 along z";
  discrete output Types.Force F_y_2(start = 0, fixed = true) "Commanded force on test mass 2 along y";
  discrete output Types.Force F_z_2(start = 0, fixed = true) "Commanded force on test mass 2 along z";
  discrete output Types.Torque N_theta_1(start = 0, fixed = true) "Commanded torque on test mass 1 about x";
  discrete output Types.Torque N_eta_1(start = 0, fixed = true) "Commanded torque on test mass 1 about y";
  discrete output Types.Torque N_phi_1(start = 0, fixed = true) "Commanded torque on test mass 1 about z";
  discrete output Types.Torque N_theta_2(start = 0, fixed = true) "Commanded torque on test mass 2 about x";
  discrete output Types.Torque N_eta_2(start = 0, fixed = true) "Commanded torque on test mass 2 about y";
  discrete output Types.Torque N_phi_2(start = 0, fixed = true) "Commanded torque on test mass 2 about z";
  discrete output Types.Acceleration f_applied_1(start = 0, fixed = true)
    "x force per unit mass that test mass 1 receives after its delay";
  discrete output Types.Acceleration f_applied_2(start = lambda_2*f_x_2_start, fixed = true)
    "x force per unit mass that test mass 2 receives after its delay";
  output Types.Force F_applied_y_1 "Force along y that test mass 1 receives after its delay";
  output Types.Force F_applied_z_1 "Force along z that test mass 1 receives after its delay";
  output Types.Force F_applied_y_2 "Force along y that test mass 2 receives after its delay";
  output Types.Force F_applied_z_2 "Force along z that test mass 2 receives after its delay";
  output Types.Torque N_applied_theta_1 "Torque about x that test mass 1 receives after its delay";
  output Types.Torque N_applied_eta_1 "Torque about y that test mass 1 receives after its delay";
  output Types.Torque N_applied_phi_1 "Torque about z that test mass 1 receives after its delay";
  output Types.Torque N_applied_theta_2 "Torque about x that test mass 2 receives after its delay";
  output Types.Torque N_applied_eta_2 "Torque about y that test mass 2 receives after its delay";
  output Types.Torque N_applied_phi_2 "Torque about z that test mass 2 receives after its delay";
equation
  when sample(0, h) then
    F_y_1 = limited(F_control_y_1, F_max_yz);
    F_z_1 = limited(F_control_z_1, F_max_yz);
    F_y_2 = limited(F_control_y_2, F_max_yz);
    F_z_2 = limited(F_control_z_2, F_max_yz);
    N_theta_1 = limited(N_control_theta_1, N_max_theta);
    N_eta_1 = limited(N_control_eta_1, N_max_eta);
    N_phi_1 = limited(N_control_phi_1, N_max_1);
    N_theta_2 = limited(N_control_theta_2, N_max_theta);
    N_eta_2 = limited(N_control_eta_2, N_max_eta);
    N_phi_2 = limited(N_control_phi_2, N_max_2);
    f_x_1 = (limited(F_x_1, F_max_1) + leak_phi_1*N_phi_1)/m_tm + f_x_1_jitter;
    f_x_2 = limited(m_tm*f_control_2 + F_x_2, F_max_2)/m_tm;
    f_applied_1 = pulled(lambda_1, f_x_1, bend_1, gain_1) + e_x_1*balance_1
      + e_N_1*N_phi_1/(arm*m_tm);
    f_applied_2 = pulled(lambda_2, f_x_2, bend_2, gain_2)
      + (kappa_phi*N_phi_2 + kappa_eta*N_eta_2)/m_tm
      + e_x_2*balance_2 + e_N_2*N_phi_2/(arm*m_tm);
  end when;
  F_applied_y_1 = lambda_1*F_y_1;
  F_applied_z_1 = lambda_1*F_z_1;
  F_applied_y_2 = lambda_2*F_y_2;
  F_applied_z_2 = lambda_2*F_z_2;
  N_applied_theta_1 = lambda_N*N_theta_1;
  N_applied_eta_1 = lambda_N*N_eta_1;
  N_applied_phi_1 = lambda_N*N_phi_1;
  N_applied_theta_2 = lambda_N*N_theta_2;
  N_applied_eta_2 = lambda_N*N_eta_2;
  N_applied_phi_2 = lambda_N*N_phi_2;
end WholeActuation;
