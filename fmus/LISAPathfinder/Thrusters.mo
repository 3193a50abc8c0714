within LISAPathfinder;
model Thrusters "Thrusters along x: transport delay, then a first-order lag"
  parameter Types.Time tau_sc = 0.25 "Transport delay of the thrust command";
  parameter Types.Time T_sc = 0.1 "Lag of the thrust";
  parameter Types.Thrust F_x_sc_start = 0 "Thrust at the start";
  input Types.Thrust F_x_sc "Commanded thrust, held between samples";
  output Types.Thrust F_thrust(start = F_x_sc_start, fixed = true) "Thrust";
equation
  T_sc*der(F_thrust) = delay(F_x_sc, tau_sc) - F_thrust;
end Thrusters;
