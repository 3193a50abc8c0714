within LISA.Examples;
model ClosedLoop "Drag-free, suspension, attitude and opening loops of one spacecraft"
  extends Icons.Example;
  Metrology metrology(n_1 = 0, n_2 = 0, n_eta_1 = 0, n_phi_1 = 0, n_eta_2 = 0, n_phi_2 = 0, n_dws_eta_1 = 0,
    n_dws_phi_1 = 0, n_dws_eta_2 = 0, n_dws_phi_2 = 0)
    "Interferometers and wavefront sensors" annotation (Placement(transformation(extent = {{-70,30},{-50,50}})));
  SixDof.InertialSensor inertialSensor(n_grs_x_1 = 0, n_grs_y_1 = 0, n_grs_z_1 = 0, n_grs_theta_1 = 0,
    n_grs_eta_1 = 0, n_grs_phi_1 = 0, n_grs_x_2 = 0, n_grs_y_2 = 0, n_grs_z_2 = 0, n_grs_theta_2 = 0,
    n_grs_eta_2 = 0, n_grs_phi_2 = 0)
    "The capacitive read-outs" annotation (Placement(transformation(extent = {{-70,-10},{-50,10}})));
  DragFreeControl dragFree(guidance_o_2 = 0, guidance_y_1 = 0)
    "The drag-free control" annotation (Placement(transformation(extent = {{-30,30},{-10,50}})));
  SuspensionControl suspension(guidance_o_2 = 0, guidance_y_1 = 0, guidance_y_2 = 0, guidance_z = 0,
    guidance_theta_1 = 0, guidance_eta_1 = 0, guidance_phi_1 = 0, guidance_theta_2 = 0, guidance_eta_2 = 0,
    guidance_phi_2 = 0)
    "The suspension control" annotation (Placement(transformation(extent = {{-30,-10},{-10,10}})));
  PointingControl pointing(guidance_theta = 0, guidance_eta = 0, guidance_phi = 0, guidance_opening = 0)
    "The pointing control" annotation (Placement(transformation(extent = {{-30,-50},{-10,-30}})));
  Actuation actuation(e_x_1 = 0, e_y_1 = 0, e_x_2 = 0, e_y_2 = 0)
    "The capacitive actuation" annotation (Placement(transformation(extent = {{10,-10},{30,10}})));
  Plant plant(n_mosa_1 = 0, n_mosa_2 = 0, F_noise_x_sc = 0, F_noise_y_sc = 0, F_noise_z_sc = 0, N_noise_x_sc = 0,
    N_noise_y_sc = 0, N_noise_z_sc = 0, g_1 = 0, g_y_1 = 0, g_z_1 = 0, gamma_theta_1 = 0, gamma_eta_1 = 0,
    gamma_phi_1 = 0, g_2 = 0, g_y_2 = 0, g_z_2 = 0, gamma_theta_2 = 0, gamma_eta_2 = 0, gamma_phi_2 = 0)
    "Spacecraft, assemblies and test masses" annotation (Placement(transformation(extent = {{50,-10},{70,10}})));
  LISAPathfinder.Sources.Sine guidance "Injection into the set point of o_1"
    annotation (Placement(transformation(extent = {{-110,30},{-90,50}})));
equation
  connect(plant.x_1, metrology.x_1);
  connect(plant.y_1, metrology.y_1);
  connect(plant.z_1, metrology.z_1);
  connect(plant.eta_1, metrology.eta_1);
  connect(plant.phi_1, metrology.phi_1);
  connect(plant.yaw_1, metrology.yaw_1);
  connect(plant.x_2, metrology.x_2);
  connect(plant.y_2, metrology.y_2);
  connect(plant.z_2, metrology.z_2);
  connect(plant.eta_2, metrology.eta_2);
  connect(plant.phi_2, metrology.phi_2);
  connect(plant.yaw_2, metrology.yaw_2);
  connect(plant.Theta, metrology.Theta);
  connect(plant.Eta, metrology.Eta);
  connect(plant.Phi, metrology.Phi);
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
  connect(metrology.o_1, dragFree.o_1);
  connect(metrology.o_2, dragFree.o_2);
  connect(guidance.y, dragFree.guidance_o_1);
  connect(inertialSensor.grs_y_1, dragFree.grs_y_1);
  connect(inertialSensor.grs_z_1, dragFree.grs_z_1);
  connect(inertialSensor.grs_z_2, dragFree.grs_z_2);
  connect(metrology.o_2, suspension.o_2);
  connect(inertialSensor.grs_y_1, suspension.grs_y_1);
  connect(inertialSensor.grs_y_2, suspension.grs_y_2);
  connect(inertialSensor.grs_z_1, suspension.grs_z_1);
  connect(inertialSensor.grs_z_2, suspension.grs_z_2);
  connect(inertialSensor.grs_theta_1, suspension.grs_theta_1);
  connect(metrology.o_eta_1, suspension.o_eta_1);
  connect(metrology.o_phi_1, suspension.o_phi_1);
  connect(inertialSensor.grs_theta_2, suspension.grs_theta_2);
  connect(metrology.o_eta_2, suspension.o_eta_2);
  connect(metrology.o_phi_2, suspension.o_phi_2);
  connect(metrology.dws_eta_1, pointing.dws_eta_1);
  connect(metrology.dws_phi_1, pointing.dws_phi_1);
  connect(metrology.dws_eta_2, pointing.dws_eta_2);
  connect(metrology.dws_phi_2, pointing.dws_phi_2);
  connect(suspension.F_control_x_2, actuation.F_control_x_2);
  connect(suspension.F_control_y_1, actuation.F_control_y_1);
  connect(suspension.F_control_z_1, actuation.F_control_z_1);
  connect(suspension.F_control_y_2, actuation.F_control_y_2);
  connect(suspension.F_control_z_2, actuation.F_control_z_2);
  connect(suspension.N_control_theta_1, actuation.N_control_theta_1);
  connect(suspension.N_control_eta_1, actuation.N_control_eta_1);
  connect(suspension.N_control_phi_1, actuation.N_control_phi_1);
  connect(suspension.N_control_theta_2, actuation.N_control_theta_2);
  connect(suspension.N_control_eta_2, actuation.N_control_eta_2);
  connect(suspension.N_control_phi_2, actuation.N_control_phi_2);
  connect(actuation.F_applied_x_1, plant.F_applied_x_1);
  connect(actuation.F_applied_y_1, plant.F_applied_y_1);
  connect(actuation.F_applied_z_1, plant.F_applied_z_1);
  connect(actuation.N_applied_theta_1, plant.N_applied_theta_1);
  connect(actuation.N_applied_eta_1, plant.N_applied_eta_1);
  connect(actuation.N_applied_phi_1, plant.N_applied_phi_1);
  connect(actuation.F_applied_x_2, plant.F_applied_x_2);
  connect(actuation.F_applied_y_2, plant.F_applied_y_2);
  connect(actuation.F_applied_z_2, plant.F_applied_z_2);
  connect(actuation.N_applied_theta_2, plant.N_applied_theta_2);
  connect(actuation.N_applied_eta_2, plant.N_applied_eta_2);
  connect(actuation.N_applied_phi_2, plant.N_applied_phi_2);
  connect(dragFree.F_x_sc, plant.F_x_sc);
  connect(dragFree.F_y_sc, plant.F_y_sc);
  connect(dragFree.F_z_sc, plant.F_z_sc);
  connect(pointing.N_x_sc, plant.N_x_sc);
  connect(pointing.N_y_sc, plant.N_y_sc);
  connect(pointing.N_z_sc, plant.N_z_sc);
  connect(pointing.mosa_control_1, plant.mosa_control_1);
  connect(pointing.mosa_control_2, plant.mosa_control_2);
  annotation (
    experiment(StopTime = 3600, Interval = 0.1),
    Documentation(info = "<html>
<p>The loop that lpfcosim wires from FMUs, assembled by connections. The guidance moves the set point of test mass 1
along its axis: the thrusters take the spacecraft after it, and metrology.o_1 follows. With fall_back = 1 in dragFree
and suspension, test mass 2 is suspended along x_2. Noise and other set points are zero.</p>
<p>Translated as one FMU it steps like the co-simulation of its parts, which a test of lpfcosim verifies.</p>
</html>"));
end ClosedLoop;
