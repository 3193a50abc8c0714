within LISAPathfinder.SixDof;
model Actuation "Capacitive forces and torques on both test masses: authority, hold, true gain, cross-talk"
  extends OneAxis.PartialActuation(N_max_1 = 10.4e-12, N_max_2 = 10.4e-12);
  parameter Types.Ratio lambda_N = 1 "True over commanded torque on the test masses";
  parameter Types.Force F_max_yz = 50e-12 "Authority of the forces along y and z";
  parameter Types.Torque N_max_theta = 10.4e-12 "Authority of the torques about x";
  parameter Types.Torque N_max_eta = 10.4e-12 "Authority of the torques about y";
  parameter Real leak_phi_1(unit = "m-1") = 0
    "x force commanded on test mass 1 per torque about z, by imperfectly digitised waveforms";
  parameter Real kappa_phi(unit = "m-1") = 0 "x force on test mass 2 per torque about z that no command shows";
  parameter Real kappa_eta(unit = "m-1") = 0 "x force on test mass 2 per torque about y that no command shows";
  Interfaces.ForceInput F_control_y_1 "Force demanded by the attitude control on test mass 1 along y";
  Interfaces.ForceInput F_control_z_1 "Force demanded by the attitude control on test mass 1 along z";
  Interfaces.ForceInput F_control_y_2 "Force demanded by the attitude control on test mass 2 along y";
  Interfaces.ForceInput F_control_z_2 "Force demanded by the attitude control on test mass 2 along z";
  Interfaces.TorqueInput N_control_theta_1 "Torque demanded by the controllers on test mass 1 about x";
  Interfaces.TorqueInput N_control_eta_1 "Torque demanded by the controllers on test mass 1 about y";
  Interfaces.TorqueInput N_control_phi_1 "Torque demanded by the controllers on test mass 1 about z";
  Interfaces.TorqueInput N_control_theta_2 "Torque demanded by the controllers on test mass 2 about x";
  Interfaces.TorqueInput N_control_eta_2 "Torque demanded by the controllers on test mass 2 about y";
  Interfaces.TorqueInput N_control_phi_2 "Torque demanded by the controllers on test mass 2 about z";
  Interfaces.RatioInput e_N_1 "Relative voltage noise between the electrodes at the two ends of test mass 1";
  Interfaces.RatioInput e_N_2 "Relative voltage noise between the electrodes at the two ends of test mass 2";
  discrete Interfaces.ForceOutput F_y_1(start = 0, fixed = true) "Commanded force on test mass 1 along y";
  discrete Interfaces.ForceOutput F_z_1(start = 0, fixed = true) "Commanded force on test mass 1 along z";
  discrete Interfaces.ForceOutput F_y_2(start = 0, fixed = true) "Commanded force on test mass 2 along y";
  discrete Interfaces.ForceOutput F_z_2(start = 0, fixed = true) "Commanded force on test mass 2 along z";
  discrete Interfaces.TorqueOutput N_theta_1(start = 0, fixed = true) "Commanded torque on test mass 1 about x";
  discrete Interfaces.TorqueOutput N_eta_1(start = 0, fixed = true) "Commanded torque on test mass 1 about y";
  discrete Interfaces.TorqueOutput N_phi_1(start = 0, fixed = true) "Commanded torque on test mass 1 about z";
  discrete Interfaces.TorqueOutput N_theta_2(start = 0, fixed = true) "Commanded torque on test mass 2 about x";
  discrete Interfaces.TorqueOutput N_eta_2(start = 0, fixed = true) "Commanded torque on test mass 2 about y";
  discrete Interfaces.TorqueOutput N_phi_2(start = 0, fixed = true) "Commanded torque on test mass 2 about z";
  Interfaces.ForceOutput F_applied_y_1 "Force along y that test mass 1 receives after its delay";
  Interfaces.ForceOutput F_applied_z_1 "Force along z that test mass 1 receives after its delay";
  Interfaces.ForceOutput F_applied_y_2 "Force along y that test mass 2 receives after its delay";
  Interfaces.ForceOutput F_applied_z_2 "Force along z that test mass 2 receives after its delay";
  Interfaces.TorqueOutput N_applied_theta_1 "Torque about x that test mass 1 receives after its delay";
  Interfaces.TorqueOutput N_applied_eta_1 "Torque about y that test mass 1 receives after its delay";
  Interfaces.TorqueOutput N_applied_phi_1 "Torque about z that test mass 1 receives after its delay";
  Interfaces.TorqueOutput N_applied_theta_2 "Torque about x that test mass 2 receives after its delay";
  Interfaces.TorqueOutput N_applied_eta_2 "Torque about y that test mass 2 receives after its delay";
  Interfaces.TorqueOutput N_applied_phi_2 "Torque about z that test mass 2 receives after its delay";
equation
  when sample(0, h) then
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
  end when;
  leak = leak_phi_1*N_phi_1/m_tm;
  coupling_1 = e_N_1*N_phi_1/(arm*m_tm);
  coupling_2 = (kappa_phi*N_phi_2 + kappa_eta*N_eta_2)/m_tm + e_N_2*N_phi_2/(arm*m_tm);
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
  annotation (Documentation(info = "<html>
<p>OneAxis.PartialActuation along x, and in the other degrees of freedom</p>
<pre>
  F_y_j = limit(F_control_y_j),   F_applied_y_j = lambda_j*F_y_j,   likewise z
  N_phi_j = limit(N_control_phi_j),   N_applied_phi_j = lambda_N*N_phi_j,   likewise theta, eta
</pre>
<p>sampled every h and held. Torques about z leak into the command along x (leak_phi_1), torques about y and z into the
force on test mass 2 (kappa_eta, kappa_phi), and voltage noise e_N_j between the ends of a test mass into its force.</p>
<p>Defaults: nominal authority in Phys. Rev. D 97, 122002 (2018); 50 pN along y and z a choice.</p>
</html>"));
end Actuation;
