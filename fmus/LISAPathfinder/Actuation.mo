within LISAPathfinder;
model Actuation "Capacitive actuation along x: authority, hold and true gain"
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Mass m_tm = 1.928 "Mass of each test mass";
  parameter Real lambda_1(unit = "1") = 1.0748 "True over commanded force on test mass 1";
  parameter Real lambda_2(unit = "1") = 1.0776 "True over commanded force on test mass 2";
  parameter Types.Force F_max_1 = 0 "Authority of the x force on test mass 1";
  parameter Types.Force F_max_2 = 2200e-12 "Authority of the x force on test mass 2";
  parameter Types.Acceleration f_x_2_start = 0 "Command on test mass 2 before the first sample";
  input Types.Acceleration f_control_2 "Force per unit mass that the suspension control asks for";
  input Types.Force F_x_1 "Injected force command on test mass 1";
  input Types.Force F_x_2 "Injected force command on test mass 2";
  input Types.Acceleration f_x_1_jitter "Leak of imperfectly digitised torque waveforms into x";
  discrete output Types.Acceleration f_x_1(start = 0, fixed = true) "Commanded force per unit mass on test mass 1";
  discrete output Types.Acceleration f_x_2(start = f_x_2_start, fixed = true)
    "Commanded force per unit mass on test mass 2";
  output Types.Acceleration f_applied_1 "Force per unit mass that test mass 1 receives after its delay";
  output Types.Acceleration f_applied_2 "Force per unit mass that test mass 2 receives after its delay";
equation
  when sample(0, h) then
    f_x_1 = max(-F_max_1, min(F_max_1, F_x_1))/m_tm + f_x_1_jitter;
    f_x_2 = max(-F_max_2, min(F_max_2, m_tm*f_control_2 + F_x_2))/m_tm;
  end when;
  f_applied_1 = lambda_1*f_x_1;
  f_applied_2 = lambda_2*f_x_2;
end Actuation;
