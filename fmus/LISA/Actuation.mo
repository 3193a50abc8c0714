within LISA;
model Actuation "Capacitive forces and torques on both test masses: authority, hold, true gain, cross-talk"
  extends Icons.Actuator;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Ratio lambda_x_2 = 1 "True over commanded force on test mass 2 along x_2";
  parameter Types.Ratio lambda_y_1 = 1 "True over commanded force on test mass 1 along y_1";
  parameter Types.Ratio lambda_y_2 = 1 "True over commanded force on test mass 2 along y_2";
  parameter Types.Ratio lambda_z_1 = 1 "True over commanded force on test mass 1 along z_1";
  parameter Types.Ratio lambda_z_2 = 1 "True over commanded force on test mass 2 along z_2";
  parameter Types.Ratio lambda_N = 1 "True over commanded torque on the test masses";
  parameter Types.Ratio x_per_y_1 = 0 "Force along x_1 per force commanded along y_1";
  parameter Types.Ratio x_per_y_2 = 0 "Force along x_2 per force commanded along y_2";
  parameter Real x_per_phi_1(unit = "m-1") = 0 "Force along x_1 per torque commanded about z_1";
  parameter Real x_per_phi_2(unit = "m-1") = 0 "Force along x_2 per torque commanded about z_2";
  parameter Types.Length arm = 0.011 "Arm of an electrode about the middle of its face";
  parameter Types.Force F_max_1 = 0 "Authority of the force on test mass 1 along x_1, which nothing demands";
  parameter Types.Force F_max_2 = 2200e-12 "Authority of the force on test mass 2 along x_2";
  parameter Types.Force F_max_yz = 2200e-12 "Authority of the forces along y and z";
  parameter Types.Torque N_max_theta = 10.4e-12 "Authority of the torques about x";
  parameter Types.Torque N_max_eta = 10.4e-12 "Authority of the torques about y";
  parameter Types.Torque N_max_1 = 10.4e-12 "Authority of the torque on test mass 1 about z";
  parameter Types.Torque N_max_2 = 10.4e-12 "Authority of the torque on test mass 2 about z";
  Interfaces.RatioInput e_x_1 "Relative voltage noise between the electrodes at the two sides of test mass 1 along x_1";
  Interfaces.RatioInput e_y_1 "Relative voltage noise between the electrodes at the two sides of test mass 1 along y_1";
  Interfaces.RatioInput e_x_2 "Relative voltage noise between the electrodes at the two sides of test mass 2 along x_2";
  Interfaces.RatioInput e_y_2 "Relative voltage noise between the electrodes at the two sides of test mass 2 along y_2";
  Interfaces.ForceInput F_control_x_2 "Force demanded on test mass 2 along x_2, in the fall-back";
  Interfaces.ForceInput F_control_y_1 "Force demanded on test mass 1 along y_1";
  Interfaces.ForceInput F_control_z_1 "Force demanded on test mass 1 along z_1";
  Interfaces.ForceInput F_control_y_2 "Force demanded on test mass 2 along y_2";
  Interfaces.ForceInput F_control_z_2 "Force demanded on test mass 2 along z_2";
  Interfaces.TorqueInput N_control_theta_1 "Torque demanded on test mass 1 about x_1";
  Interfaces.TorqueInput N_control_eta_1 "Torque demanded on test mass 1 about y_1";
  Interfaces.TorqueInput N_control_phi_1 "Torque demanded on test mass 1 about z_1";
  Interfaces.TorqueInput N_control_theta_2 "Torque demanded on test mass 2 about x_2";
  Interfaces.TorqueInput N_control_eta_2 "Torque demanded on test mass 2 about y_2";
  Interfaces.TorqueInput N_control_phi_2 "Torque demanded on test mass 2 about z_2";
  discrete Interfaces.ForceOutput F_x_2(start = 0, fixed = true) "Commanded force on test mass 2 along x_2";
  discrete Interfaces.ForceOutput F_y_1(start = 0, fixed = true) "Commanded force on test mass 1 along y_1";
  discrete Interfaces.ForceOutput F_z_1(start = 0, fixed = true) "Commanded force on test mass 1 along z_1";
  discrete Interfaces.ForceOutput F_y_2(start = 0, fixed = true) "Commanded force on test mass 2 along y_2";
  discrete Interfaces.ForceOutput F_z_2(start = 0, fixed = true) "Commanded force on test mass 2 along z_2";
  discrete Interfaces.TorqueOutput N_theta_1(start = 0, fixed = true) "Commanded torque on test mass 1 about x_1";
  discrete Interfaces.TorqueOutput N_eta_1(start = 0, fixed = true) "Commanded torque on test mass 1 about y_1";
  discrete Interfaces.TorqueOutput N_phi_1(start = 0, fixed = true) "Commanded torque on test mass 1 about z_1";
  discrete Interfaces.TorqueOutput N_theta_2(start = 0, fixed = true) "Commanded torque on test mass 2 about x_2";
  discrete Interfaces.TorqueOutput N_eta_2(start = 0, fixed = true) "Commanded torque on test mass 2 about y_2";
  discrete Interfaces.TorqueOutput N_phi_2(start = 0, fixed = true) "Commanded torque on test mass 2 about z_2";
  discrete Interfaces.ForceOutput F_applied_x_1(start = 0, fixed = true) "Force along x_1 that test mass 1 receives after its delay";
  discrete Interfaces.ForceOutput F_applied_y_1(start = 0, fixed = true) "Force along y_1 that test mass 1 receives after its delay";
  Interfaces.ForceOutput F_applied_z_1 "Force along z_1 that test mass 1 receives after its delay";
  Interfaces.TorqueOutput N_applied_theta_1 "Torque about x_1 that test mass 1 receives after its delay";
  Interfaces.TorqueOutput N_applied_eta_1 "Torque about y_1 that test mass 1 receives after its delay";
  Interfaces.TorqueOutput N_applied_phi_1 "Torque about z_1 that test mass 1 receives after its delay";
  discrete Interfaces.ForceOutput F_applied_x_2(start = 0, fixed = true) "Force along x_2 that test mass 2 receives after its delay";
  discrete Interfaces.ForceOutput F_applied_y_2(start = 0, fixed = true) "Force along y_2 that test mass 2 receives after its delay";
  Interfaces.ForceOutput F_applied_z_2 "Force along z_2 that test mass 2 receives after its delay";
  Interfaces.TorqueOutput N_applied_theta_2 "Torque about x_2 that test mass 2 receives after its delay";
  Interfaces.TorqueOutput N_applied_eta_2 "Torque about y_2 that test mass 2 receives after its delay";
  Interfaces.TorqueOutput N_applied_phi_2 "Torque about z_2 that test mass 2 receives after its delay";
equation
  when sample(0, h) then
    F_x_2 = Functions.limit(F_control_x_2, F_max_2);
    F_y_1 = Functions.limit(F_control_y_1, F_max_yz);
    F_z_1 = Functions.limit(F_control_z_1, F_max_yz);
    F_y_2 = Functions.limit(F_control_y_2, F_max_yz);
    F_z_2 = Functions.limit(F_control_z_2, F_max_yz);
    N_theta_1 = Functions.limit(N_control_theta_1, N_max_theta);
    N_eta_1 = Functions.limit(N_control_eta_1, N_max_eta);
    N_phi_1 = Functions.limit(N_control_phi_1, N_max_1);
    N_theta_2 = Functions.limit(N_control_theta_2, N_max_theta);
    N_eta_2 = Functions.limit(N_control_eta_2, N_max_eta);
    N_phi_2 = Functions.limit(N_control_phi_2, N_max_2);
    F_applied_x_1 = x_per_y_1*F_y_1 + x_per_phi_1*N_phi_1 + e_x_1*(F_max_1 + N_max_1/arm);
    F_applied_x_2 = lambda_x_2*F_x_2 + x_per_y_2*F_y_2 + x_per_phi_2*N_phi_2 + e_x_2*(F_max_2 + N_max_2/arm);
    F_applied_y_1 = lambda_y_1*F_y_1 + e_y_1*F_max_yz;
    F_applied_y_2 = lambda_y_2*F_y_2 + e_y_2*F_max_yz;
  end when;
  F_applied_z_1 = lambda_z_1*F_z_1;
  F_applied_z_2 = lambda_z_2*F_z_2;
  N_applied_theta_1 = lambda_N*N_theta_1;
  N_applied_eta_1 = lambda_N*N_eta_1;
  N_applied_phi_1 = lambda_N*N_phi_1;
  N_applied_theta_2 = lambda_N*N_theta_2;
  N_applied_eta_2 = lambda_N*N_eta_2;
  N_applied_phi_2 = lambda_N*N_phi_2;
  annotation (Documentation(info = "<html>
<pre>
  F_z_j = limit(F_control_z_j),       F_applied_z_j = lambda_z_j*F_z_j,       likewise y, and x on test mass 2
  N_phi_j = limit(N_control_phi_j),   N_applied_phi_j = lambda_N*N_phi_j,     likewise theta, eta
  F_applied_x_j = lambda_x_j*F_x_j + x_per_y_j*F_y_j + x_per_phi_j*N_phi_j + e_x_j*(F_max_j + N_max_j/arm)
  F_applied_y_j = lambda_y_j*F_y_j + e_y_j*F_max_yz                           F_x_1 = 0
</pre>
<p>sampled every h and held; in axes of the housings. Nothing is commanded along x in science mode, along x_2 in the
fall-back; what is commanded along y or about z leaks into x. Electrodes on both sides of a test mass pull with its
authority all the time, and relative noise e of their voltages leaves a difference (as in LISA Pathfinder; along x those
that turn about z count, too).</p>
<p>Defaults: authorities are a choice, of the order of LISA Pathfinder.</p>
</html>"));
end Actuation;
