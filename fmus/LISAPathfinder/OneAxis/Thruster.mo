within LISAPathfinder.OneAxis;
model Thruster "Thrusters in one degree of freedom: transport delay, then a first-order lag"
  extends Icons.Actuator;
  replaceable type Effort = Types.Thrust constrainedby Real "Force or torque";
  parameter Types.Time tau_sc = 0.25 "Transport delay of the thrust command";
  parameter Types.Time T_sc = 0.1 "Lag of the thrust";
  input Effort F "Commanded thrust, held between samples";
  output Effort F_thrust(start = 0, fixed = true) "Thrust";
equation
  T_sc*der(F_thrust) = delay(F, tau_sc) - F_thrust;
  annotation (Documentation(info = "<html>
<pre>
  T_sc*F_thrust' = F(t - tau_sc) - F_thrust
</pre>
<p>The command F is held between samples. Defaults: a choice that gives the drag-free loop its measured phase.</p>
</html>"));
end Thruster;
