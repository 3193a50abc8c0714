within LISAPathfinder;
model OpticalMetrology "The two interferometers along x"
  parameter Real delta_ifo(unit = "1") = -2.2e-5 "Cross-talk of x_1 into the differential read-out";
  input Types.Position x_1 "Position of test mass 1";
  input Types.Position x_2 "Position of test mass 2";
  input Types.Position n_1(nominal = 1e-13) "Read-out noise of o_1";
  input Types.Position n_12(nominal = 1e-13) "Read-out noise of o_12";
  output Types.Position o_1 "Read-out of test mass 1 against the spacecraft";
  output Types.Position o_12 "Read-out of test mass 2 against test mass 1";
equation
  o_1 = x_1 + n_1;
  o_12 = x_2 - x_1 + delta_ifo*x_1 + n_12;
end OpticalMetrology;
