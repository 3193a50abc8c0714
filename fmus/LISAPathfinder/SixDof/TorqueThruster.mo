within LISAPathfinder.SixDof;
model TorqueThruster "Thrusters about one axis: transport delay, then a first-order lag"
  extends OneAxis.Thruster(redeclare type Effort = Types.ThrustTorque);
  annotation (Documentation(info = "<html>
<p>OneAxis.Thruster for a torque.</p>
</html>"));
end TorqueThruster;
