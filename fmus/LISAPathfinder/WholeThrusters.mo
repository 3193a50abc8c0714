within LISAPathfinder;
model WholeThrusters "Thrusters in six degrees of freedom: transport delay, then a first-order lag"
  parameter Types.Time tau_sc = 0.25 "Transport delay of the commands";
  parameter Types.Time T_sc = 0.1 "Lag of the thrust";
  parameter Types.Thrust F_sc_start[3] = zeros(3) "Thrust at the start";
  input Types.Thrust F_sc[3] "Commanded thrust, held between samples";
  input Types.ThrustTorque N_sc[3] "Commanded torque, held between samples";
  output Types.Thrust F_thrust[3](start = F_sc_start, each fixed = true) "Thrust";
  output Types.ThrustTorque N_thrust[3](each start = 0, each fixed = true) "Torque";
equation
  T_sc*der(F_thrust) = {delay(F_sc[1], tau_sc), delay(F_sc[2], tau_sc), delay(F_sc[3], tau_sc)} - F_thrust;
  T_sc*der(N_thrust) = {delay(N_sc[1], tau_sc), delay(N_sc[2], tau_sc), delay(N_sc[3], tau_sc)} - N_thrust;
end WholeThrusters;
