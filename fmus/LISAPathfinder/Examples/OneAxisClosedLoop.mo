within LISAPathfinder.Examples;
model OneAxisClosedLoop "Drag-free and suspension loop along x"
  extends Icons.Example;
  OneAxis.Interferometer interferometer "The interferometers"
    annotation (Placement(transformation(extent = {{-70,30},{-50,50}})));
  OneAxis.DragFreeController dragFree "The drag-free control"
    annotation (Placement(transformation(extent = {{-30,30},{-10,50}})));
  OneAxis.SuspensionController suspension "The suspension control"
    annotation (Placement(transformation(extent = {{-30,-10},{-10,10}})));
  OneAxis.Actuation actuation "The capacitive actuation"
    annotation (Placement(transformation(extent = {{10,-10},{30,10}})));
  OneAxis.Plant plant "Spacecraft and test masses"
    annotation (Placement(transformation(extent = {{50,-10},{70,10}})));
  Sources.OneAxisSignals signals "External signals, zero unless set"
    annotation (Placement(transformation(extent = {{-110,-10},{-90,10}})));
  Sources.Sine guidance "Injection into the set point of o_12"
    annotation (Placement(transformation(extent = {{-110,50},{-90,70}})));
equation
  connect(plant.x_1, interferometer.x_1);
  connect(plant.x_2, interferometer.x_2);
  connect(interferometer.o_1, dragFree.o_1);
  connect(interferometer.o_12, suspension.o_12);
  connect(guidance.y, suspension.guidance_o_12);
  connect(suspension.f_control_2, actuation.f_control_2);
  connect(actuation.f_applied_1, plant.f_applied_1);
  connect(actuation.f_applied_2, plant.f_applied_2);
  connect(dragFree.F_x_sc, plant.F_x_sc);
  // External signals
  connect(signals.n_1, interferometer.n_1);
  connect(signals.n_12, interferometer.n_12);
  connect(signals.guidance_o_1, dragFree.guidance_o_1);
  connect(signals.F_x_1, actuation.F_x_1);
  connect(signals.F_x_2, actuation.F_x_2);
  connect(signals.f_x_1_jitter, actuation.f_x_1_jitter);
  connect(signals.gain_1, actuation.gain_1);
  connect(signals.gain_2, actuation.gain_2);
  connect(signals.e_x_1, actuation.e_x_1);
  connect(signals.e_x_2, actuation.e_x_2);
  connect(signals.g_1, plant.g_1);
  connect(signals.g_2, plant.g_2);
  connect(signals.F_noise_x_sc, plant.F_noise_x_sc);
  annotation (
    experiment(StopTime = 3600, Interval = 0.1),
    Documentation(info = "<html>
<p>The loop that lpfcosim wires from FMUs, assembled by connections. The guidance moves the set point of the differential
read-out; interferometer.o_12 follows it within the bandwidth of the suspension, and actuation.f_x_2 is the command.</p>
<p>Translated as one FMU it steps like the co-simulation of its parts, which a test of lpfcosim verifies.</p>
</html>"));
end OneAxisClosedLoop;
