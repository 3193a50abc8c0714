within LISAPathfinder.Examples;
model SixDofClosedLoop "Drag-free, suspension and attitude loops in six degrees of freedom"
  extends Icons.Example;
  SixDof.Interferometer interferometer "The interferometers"
    annotation (Placement(transformation(extent = {{-70,30},{-50,50}})));
  SixDof.InertialSensor inertialSensor "The capacitive read-outs"
    annotation (Placement(transformation(extent = {{-70,-10},{-50,10}})));
  SixDof.StarTracker starTracker "The star tracker"
    annotation (Placement(transformation(extent = {{-70,-50},{-50,-30}})));
  SixDof.DragFreeController dragFree "The drag-free control"
    annotation (Placement(transformation(extent = {{-30,30},{-10,50}})));
  SixDof.SuspensionController suspension "The suspension control"
    annotation (Placement(transformation(extent = {{-30,-10},{-10,10}})));
  SixDof.AttitudeController attitude "The attitude control"
    annotation (Placement(transformation(extent = {{-30,-50},{-10,-30}})));
  SixDof.Actuation actuation "The capacitive actuation"
    annotation (Placement(transformation(extent = {{10,-10},{30,10}})));
  SixDof.Plant plant "Spacecraft and test masses"
    annotation (Placement(transformation(extent = {{50,-10},{70,10}})));
  Sources.SixDofSignals signals "External signals, zero unless set"
    annotation (Placement(transformation(extent = {{-110,-10},{-90,10}})));
  Sources.Sine guidance "Injection into the set point of o_12"
    annotation (Placement(transformation(extent = {{-110,50},{-90,70}})));
equation
  connect(plant.x_1, interferometer.x_1);
  connect(plant.x_2, interferometer.x_2);
  connect(plant.y_1, interferometer.y_1);
  connect(plant.y_2, interferometer.y_2);
  connect(plant.z_1, interferometer.z_1);
  connect(plant.z_2, interferometer.z_2);
  connect(plant.eta_1, interferometer.eta_1);
  connect(plant.eta_2, interferometer.eta_2);
  connect(plant.phi_1, interferometer.phi_1);
  connect(plant.phi_2, interferometer.phi_2);
  connect(plant.x_1, inertialSensor.x_1);
  connect(plant.y_1, inertialSensor.y_1);
  connect(plant.z_1, inertialSensor.z_1);
  connect(plant.theta_1, inertialSensor.theta_1);
  connect(plant.eta_1, inertialSensor.eta_1);
  connect(plant.phi_1, inertialSensor.phi_1);
  connect(plant.x_2, inertialSensor.x_2);
  connect(plant.y_2, inertialSensor.y_2);
  connect(plant.z_2, inertialSensor.z_2);
  connect(plant.theta_2, inertialSensor.theta_2);
  connect(plant.eta_2, inertialSensor.eta_2);
  connect(plant.phi_2, inertialSensor.phi_2);
  connect(plant.Theta, starTracker.Theta);
  connect(plant.Eta, starTracker.Eta);
  connect(plant.Phi, starTracker.Phi);
  connect(interferometer.o_1, dragFree.o_1);
  connect(inertialSensor.grs_y_1, dragFree.grs_y_1);
  connect(inertialSensor.grs_y_2, dragFree.grs_y_2);
  connect(inertialSensor.grs_z_1, dragFree.grs_z_1);
  connect(inertialSensor.grs_z_2, dragFree.grs_z_2);
  connect(inertialSensor.grs_theta_1, dragFree.grs_theta_1);
  connect(interferometer.o_12, suspension.o_12);
  connect(interferometer.o_phi_1, suspension.o_phi_1);
  connect(interferometer.o_phi_12, suspension.o_phi_12);
  connect(interferometer.o_eta_1, suspension.o_eta_1);
  connect(interferometer.o_eta_12, suspension.o_eta_12);
  connect(guidance.y, suspension.guidance_o_12);
  connect(inertialSensor.grs_theta_2, suspension.grs_theta_2);
  connect(starTracker.ast_theta, attitude.ast_theta);
  connect(starTracker.ast_eta, attitude.ast_eta);
  connect(starTracker.ast_phi, attitude.ast_phi);
  connect(suspension.f_control_2, actuation.f_control_2);
  connect(attitude.F_control_y_1, actuation.F_control_y_1);
  connect(attitude.F_control_z_1, actuation.F_control_z_1);
  connect(attitude.F_control_y_2, actuation.F_control_y_2);
  connect(attitude.F_control_z_2, actuation.F_control_z_2);
  connect(attitude.N_control_theta_1, actuation.N_control_theta_1);
  connect(suspension.N_control_eta_1, actuation.N_control_eta_1);
  connect(suspension.N_control_phi_1, actuation.N_control_phi_1);
  connect(suspension.N_control_theta_2, actuation.N_control_theta_2);
  connect(suspension.N_control_eta_2, actuation.N_control_eta_2);
  connect(suspension.N_control_phi_2, actuation.N_control_phi_2);
  connect(actuation.f_applied_1, plant.f_applied_1);
  connect(actuation.f_applied_2, plant.f_applied_2);
  connect(actuation.F_applied_y_1, plant.F_applied_y_1);
  connect(actuation.F_applied_z_1, plant.F_applied_z_1);
  connect(actuation.F_applied_y_2, plant.F_applied_y_2);
  connect(actuation.F_applied_z_2, plant.F_applied_z_2);
  connect(actuation.N_applied_theta_1, plant.N_applied_theta_1);
  connect(actuation.N_applied_eta_1, plant.N_applied_eta_1);
  connect(actuation.N_applied_phi_1, plant.N_applied_phi_1);
  connect(actuation.N_applied_theta_2, plant.N_applied_theta_2);
  connect(actuation.N_applied_eta_2, plant.N_applied_eta_2);
  connect(actuation.N_applied_phi_2, plant.N_applied_phi_2);
  connect(dragFree.F_x_sc, plant.F_x_sc);
  connect(dragFree.F_y_sc, plant.F_y_sc);
  connect(dragFree.F_z_sc, plant.F_z_sc);
  connect(dragFree.N_x_sc, plant.N_x_sc);
  connect(dragFree.N_y_sc, plant.N_y_sc);
  connect(dragFree.N_z_sc, plant.N_z_sc);
  // External signals
  connect(signals.n_1, interferometer.n_1);
  connect(signals.n_12, interferometer.n_12);
  connect(signals.n_phi_1, interferometer.n_phi_1);
  connect(signals.n_phi_12, interferometer.n_phi_12);
  connect(signals.n_eta_1, interferometer.n_eta_1);
  connect(signals.n_eta_12, interferometer.n_eta_12);
  connect(signals.n_grs_x_1, inertialSensor.n_grs_x_1);
  connect(signals.n_grs_y_1, inertialSensor.n_grs_y_1);
  connect(signals.n_grs_z_1, inertialSensor.n_grs_z_1);
  connect(signals.n_grs_theta_1, inertialSensor.n_grs_theta_1);
  connect(signals.n_grs_eta_1, inertialSensor.n_grs_eta_1);
  connect(signals.n_grs_phi_1, inertialSensor.n_grs_phi_1);
  connect(signals.n_grs_x_2, inertialSensor.n_grs_x_2);
  connect(signals.n_grs_y_2, inertialSensor.n_grs_y_2);
  connect(signals.n_grs_z_2, inertialSensor.n_grs_z_2);
  connect(signals.n_grs_theta_2, inertialSensor.n_grs_theta_2);
  connect(signals.n_grs_eta_2, inertialSensor.n_grs_eta_2);
  connect(signals.n_grs_phi_2, inertialSensor.n_grs_phi_2);
  connect(signals.n_ast_theta, starTracker.n_ast_theta);
  connect(signals.n_ast_eta, starTracker.n_ast_eta);
  connect(signals.n_ast_phi, starTracker.n_ast_phi);
  connect(signals.guidance_o_1, dragFree.guidance_o_1);
  connect(signals.attitude_theta, attitude.attitude_theta);
  connect(signals.attitude_eta, attitude.attitude_eta);
  connect(signals.attitude_phi, attitude.attitude_phi);
  connect(signals.F_x_1, actuation.F_x_1);
  connect(signals.F_x_2, actuation.F_x_2);
  connect(signals.f_x_1_jitter, actuation.f_x_1_jitter);
  connect(signals.gain_1, actuation.gain_1);
  connect(signals.gain_2, actuation.gain_2);
  connect(signals.e_x_1, actuation.e_x_1);
  connect(signals.e_x_2, actuation.e_x_2);
  connect(signals.e_N_1, actuation.e_N_1);
  connect(signals.e_N_2, actuation.e_N_2);
  connect(signals.F_noise_x_sc, plant.F_noise_x_sc);
  connect(signals.F_noise_y_sc, plant.F_noise_y_sc);
  connect(signals.F_noise_z_sc, plant.F_noise_z_sc);
  connect(signals.N_noise_x_sc, plant.N_noise_x_sc);
  connect(signals.N_noise_y_sc, plant.N_noise_y_sc);
  connect(signals.N_noise_z_sc, plant.N_noise_z_sc);
  connect(signals.g_1, plant.g_1);
  connect(signals.g_2, plant.g_2);
  connect(signals.g_y_1, plant.g_y_1);
  connect(signals.g_z_1, plant.g_z_1);
  connect(signals.g_y_2, plant.g_y_2);
  connect(signals.g_z_2, plant.g_z_2);
  connect(signals.gamma_theta_1, plant.gamma_theta_1);
  connect(signals.gamma_eta_1, plant.gamma_eta_1);
  connect(signals.gamma_phi_1, plant.gamma_phi_1);
  connect(signals.gamma_theta_2, plant.gamma_theta_2);
  connect(signals.gamma_eta_2, plant.gamma_eta_2);
  connect(signals.gamma_phi_2, plant.gamma_phi_2);
  annotation (
    experiment(StopTime = 3600, Interval = 0.1),
    Documentation(info = "<html>
<p>The loop that lpfcosim wires from FMUs, assembled by connections. The guidance moves the set point of the differential
read-out; interferometer.o_12 follows it within the bandwidth of the suspension, and actuation.f_x_2 is the command.</p>
<p>Translated as one FMU it steps like the co-simulation of its parts, which a test of lpfcosim verifies.</p>
</html>"));
end SixDofClosedLoop;
