within LISAPathfinder.Sources;
block OneAxisSignals "External signals of the loop along x, as parameters"
  extends Icons.Source;
  parameter Types.Position n_1_held(nominal = 1e-13) = 0 "Value of n_1";
  parameter Types.Position n_12_held(nominal = 1e-13) = 0 "Value of n_12";
  parameter Types.Position guidance_o_1_held = 0 "Value of guidance_o_1";
  parameter Types.Position guidance_o_12_held = 0 "Value of guidance_o_12";
  parameter Types.Force F_x_1_held = 0 "Value of F_x_1";
  parameter Types.Force F_x_2_held = 0 "Value of F_x_2";
  parameter Types.Acceleration f_x_1_jitter_held = 0 "Value of f_x_1_jitter";
  parameter Types.Ratio gain_1_held = 0 "Value of gain_1";
  parameter Types.Ratio gain_2_held = 0 "Value of gain_2";
  parameter Types.Ratio e_x_1_held = 0 "Value of e_x_1";
  parameter Types.Ratio e_x_2_held = 0 "Value of e_x_2";
  parameter Types.Acceleration g_1_held = 0 "Value of g_1";
  parameter Types.Acceleration g_2_held = 0 "Value of g_2";
  parameter Types.Thrust F_noise_x_sc_held = 0 "Value of F_noise_x_sc";
  Interfaces.PositionOutput n_1(nominal = 1e-13) "Read-out noise of o_1";
  Interfaces.PositionOutput n_12(nominal = 1e-13) "Read-out noise of o_12";
  Interfaces.PositionOutput guidance_o_1 "Set point of o_1, an injected fake read-out";
  Interfaces.PositionOutput guidance_o_12 "Set point of o_12, an injected fake read-out";
  Interfaces.ForceOutput F_x_1 "Injected force command on test mass 1";
  Interfaces.ForceOutput F_x_2 "Injected force command on test mass 2";
  Interfaces.AccelerationOutput f_x_1_jitter "Leak of imperfectly digitised torque waveforms into x";
  output Real gain_1(unit = "1") "Relative change of lambda_1";
  output Real gain_2(unit = "1") "Relative change of lambda_2";
  output Real e_x_1(unit = "1") "Relative voltage noise between the electrodes at the two sides of test mass 1";
  output Real e_x_2(unit = "1") "Relative voltage noise between the electrodes at the two sides of test mass 2";
  Interfaces.AccelerationOutput g_1 "Stray force per unit mass on test mass 1";
  Interfaces.AccelerationOutput g_2 "Stray force per unit mass on test mass 2";
  Interfaces.ThrustOutput F_noise_x_sc "Force noise on the spacecraft";
equation
  n_1 = n_1_held;
  n_12 = n_12_held;
  guidance_o_1 = guidance_o_1_held;
  guidance_o_12 = guidance_o_12_held;
  F_x_1 = F_x_1_held;
  F_x_2 = F_x_2_held;
  f_x_1_jitter = f_x_1_jitter_held;
  gain_1 = gain_1_held;
  gain_2 = gain_2_held;
  e_x_1 = e_x_1_held;
  e_x_2 = e_x_2_held;
  g_1 = g_1_held;
  g_2 = g_2_held;
  F_noise_x_sc = F_noise_x_sc_held;
  annotation (Documentation(info = "<html>
<p>Every output has the value of the parameter of the same name with the suffix _held. Tools that read an exported
system drive the loop by these parameters, which are tunable.</p>
</html>"));
end OneAxisSignals;
