within LISAPathfinder.Test;
model DelayedStep "Thruster that receives a step of its command"
  extends Icons.Example;
  constant Types.Thrust F_0 = 1e-6 "Size of the step";
  parameter Types.Time h = 0.1 "Sampling time";
  discrete Types.Thrust F(start = 0, fixed = true) "Command, held";
  OneAxis.Thruster thruster(tau_sc = 0.234, T_sc = 0.15) "Thruster";
equation
  when sample(0, h) then
    F = if time > 0.95 then F_0 else 0;
  end when;
  thruster.F = F;
  assert(abs(thruster.F_thrust - (if time < 1.234 then 0 else F_0*(1 - exp(-(time - 1.234)/0.15)))) <= 1e-12*F_0,
    "the thrust departs from its step response");
  annotation (
    experiment(StopTime = 4, Interval = 0.1),
    Documentation(info = "<html>
<p>The command steps at 1 s; the thrust is F_0 (1 - exp(-(t - 1 s - tau_sc)/T_sc)), 
also where the delay ends inside a step.</p>
</html>"));
end DelayedStep;
