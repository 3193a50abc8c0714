within LISAPathfinder;
model DragFreeControl "The thrusters make the spacecraft follow test mass 1 along x"
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Mass m_sc = 422.7 "Mass of the spacecraft";
  parameter Types.Frequency f_u = 0.08 "Unity gain of the nominal loop";
  parameter Types.Frequency f_z = 0.03 "Lead zero";
  parameter Types.Frequency f_i = 0.006 "Zero of the integrator";
  parameter Types.Frequency f_p = 0.8 "First pole";
  parameter Types.Frequency f_r = 2 "Second pole";
  parameter Types.Thrust F_x_sc_start = 0 "Thrust commanded at zero error";
  input Types.Position o_1 "Read-out of test mass 1";
  input Types.Position guidance_o_1 "Set point of o_1, an injected fake read-out";
  output Types.Thrust F_x_sc "Commanded thrust";
  Compensator x(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r) "Control law";
equation
  x.e = o_1 - guidance_o_1;
  F_x_sc = F_x_sc_start + m_sc*x.a;
end DragFreeControl;
