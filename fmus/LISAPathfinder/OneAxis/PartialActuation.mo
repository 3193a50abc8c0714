within LISAPathfinder.OneAxis;
partial model PartialActuation "Capacitive actuation along x, with couplings that a degree of freedom may add"
  extends Icons.Actuator;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Mass m_tm = 1.928 "Mass of each test mass";
  parameter Types.Ratio lambda_1 = 1.0748 "True over commanded force on test mass 1";
  parameter Types.Ratio lambda_2 = 1.0776 "True over commanded force on test mass 2";
  parameter Types.Force F_max_1 = 0 "Authority of the x force on test mass 1";
  parameter Types.Force F_max_2 = 2200e-12 "Authority of the x force on test mass 2";
  parameter Types.Torque N_max_1 = 0 "Authority of the torque on test mass 1 about z";
  parameter Types.Torque N_max_2 = 0 "Authority of the torque on test mass 2 about z";
  parameter Types.Length arm = 0.011 "Arm of an electrode about the middle of its face";
  parameter Types.Acceleration f_x_2_start = 0 "Command on test mass 2 before the first sample";
  final parameter Types.Acceleration preload_1 = (F_max_1 + N_max_1/arm)/m_tm
    "Sum of the pulls of all electrodes on test mass 1";
  final parameter Types.Acceleration preload_2 = (F_max_2 + N_max_2/arm)/m_tm
    "Sum of the pulls of all electrodes on test mass 2";
  Interfaces.AccelerationInput f_control_2 "Force per unit mass demanded by the suspension control";
  Interfaces.ForceInput F_x_1 "Injected force command on test mass 1";
  Interfaces.ForceInput F_x_2 "Injected force command on test mass 2";
  Interfaces.AccelerationInput f_x_1_jitter "Leak of imperfectly digitised torque waveforms into x";
  Interfaces.RatioInput gain_1 "Relative change of lambda_1";
  Interfaces.RatioInput gain_2 "Relative change of lambda_2";
  Interfaces.RatioInput e_x_1 "Relative voltage noise between the electrodes at the two sides of test mass 1";
  Interfaces.RatioInput e_x_2 "Relative voltage noise between the electrodes at the two sides of test mass 2";
  discrete Interfaces.AccelerationOutput f_x_1(start = 0, fixed = true)
    "Commanded force per unit mass on test mass 1";
  discrete Interfaces.AccelerationOutput f_x_2(start = f_x_2_start, fixed = true)
    "Commanded force per unit mass on test mass 2";
  discrete Interfaces.AccelerationOutput f_applied_1(start = 0, fixed = true)
    "Force per unit mass that test mass 1 receives after its delay";
  discrete Interfaces.AccelerationOutput f_applied_2(start = lambda_2*f_x_2_start, fixed = true)
    "Force per unit mass that test mass 2 receives after its delay";
protected
  Types.Acceleration leak "Command on test mass 1 that comes from other degrees of freedom";
  Types.Acceleration coupling_1 "Acceleration of test mass 1 that comes from other degrees of freedom";
  Types.Acceleration coupling_2 "Acceleration of test mass 2 that comes from other degrees of freedom";
equation
  when sample(0, h) then
    f_x_1 = Functions.limit(F_x_1, F_max_1)/m_tm + leak + f_x_1_jitter;
    f_x_2 = Functions.limit(m_tm*f_control_2 + F_x_2, F_max_2)/m_tm;
    f_applied_1 = lambda_1*f_x_1*(1 + gain_1) + e_x_1*preload_1 + coupling_1;
    f_applied_2 = lambda_2*f_x_2*(1 + gain_2) + e_x_2*preload_2 + coupling_2;
  end when;
  annotation (Documentation(info = "<html>
<pre>
  f_x_1       = limit(F_x_1)/m_tm + leak + f_x_1_jitter                          commanded, per unit mass
  f_x_2       = limit(m_tm*f_control_2 + F_x_2)/m_tm
  f_applied_j = lambda_j*f_x_j*(1 + gain_j) + e_x_j*preload_j + coupling_j
</pre>
<p>sampled every h and held. preload_j is the sum of the pulls of all electrodes per unit mass, of which a relative
voltage noise e_x_j leaves the difference of the two sides.</p>
<p>Defaults: gains and nominal authority in Phys. Rev. D 97, 122002 (2018); the arm of an electrode is a choice.</p>
</html>"));
end PartialActuation;
