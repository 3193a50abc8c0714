within LISAPathfinder;
model Actuation "Capacitive actuation along x: authority, hold and true gain"
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Mass m_tm = 1.928 "Mass of each test mass";
  parameter Real lambda_1(unit = "1") = 1.0748 "True over commanded force on test mass 1";
  parameter Real lambda_2(unit = "1") = 1.0776 "True over commanded force on test mass 2";
  parameter Types.Force F_max_1 = 0 "Authority of the x force on test mass 1";
  parameter Types.Force F_max_2 = 2200e-12 "Authority of the x force on test mass 2";
  parameter Types.Torque N_max_1 = 0 "Authority of the torque on test mass 1 about z";
  parameter Types.Torque N_max_2 = 0 "Authority of the torque on test mass 2 about z";
  parameter Types.Length arm = 0.011 "Arm of an electrode about the middle of its face";
  parameter Real lambda_bend_1(unit = "1") = 0 "Relative growth of lambda_1 at the force F_ref";
  parameter Real lambda_bend_2(unit = "1") = 0 "Relative growth of lambda_2 at the force F_ref";
  parameter Types.Force F_ref = 1e-9 "Force that lambda_bend_1 and lambda_bend_2 refer to";
  parameter Types.Acceleration f_x_2_start = 0 "Command on test mass 2 before the first sample";
  final parameter Types.Acceleration balance_1 = (F_max_1 + N_max_1/arm)/m_tm "Pull of all electrodes on test mass 1";
  final parameter Types.Acceleration balance_2 = (F_max_2 + N_max_2/arm)/m_tm "Pull of all electrodes on test mass 2";
  final parameter Real bend_1(unit = "m-1.s2") = lambda_bend_1*m_tm/F_ref "Relative growth of lambda_1 with the command";
  final parameter Real bend_2(unit = "m-1.s2") = lambda_bend_2*m_tm/F_ref "Relative growth of lambda_2 with the command";
  input Types.Acceleration f_control_2 "Force per unit mass that the suspension control asks for";
  input Types.Force F_x_1 "Injected force command on test mass 1";
  input Types.Force F_x_2 "Injected force command on test mass 2";
  input Types.Acceleration f_x_1_jitter "Leak of imperfectly digitised torque waveforms into x";
  input Real gain_1(unit = "1") "Relative change of lambda_1";
  input Real gain_2(unit = "1") "Relative change of lambda_2";
  input Real e_x_1(unit = "1") "Relative voltage noise between the electrodes at the two sides of test mass 1";
  input Real e_x_2(unit = "1") "Relative voltage noise between the electrodes at the two sides of test mass 2";
  discrete output Types.Acceleration f_x_1(start = 0, fixed = true) "Commanded force per unit mass on test mass 1";
  discrete output Types.Acceleration f_x_2(start = f_x_2_start, fixed = true)
    "Commanded force per unit mass on test mass 2";
  discrete output Types.Acceleration f_applied_1(start = 0, fixed = true)
    "Force per unit mass that test mass 1 receives after its delay";
  discrete output Types.Acceleration f_applied_2(start = lambda_2*f_x_2_start, fixed = true)
    "Force per unit mass that test mass 2 receives after its delay";
equation
  when sample(0, h) then
    f_x_1 = max(-F_max_1, min(F_max_1, F_x_1))/m_tm + f_x_1_jitter;
    f_x_2 = max(-F_max_2, min(F_max_2, m_tm*f_control_2 + F_x_2))/m_tm;
    f_applied_1 = pulled(lambda_1, f_x_1, bend_1, gain_1) + e_x_1*balance_1;
    f_applied_2 = pulled(lambda_2, f_x_2, bend_2, gain_2) + e_x_2*balance_2;
  end when;
end Actuation;
