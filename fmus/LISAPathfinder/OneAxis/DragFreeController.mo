within LISAPathfinder.OneAxis;
model DragFreeController "The thrusters make the spacecraft follow test mass 1 along x"
  extends Icons.Controller;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Mass m_sc = 422.7 "Mass of the spacecraft";
  parameter Types.Frequency f_u = 0.08 "Unity gain of the nominal loop";
  parameter Types.Frequency f_z = 0.03 "Lead zero";
  parameter Types.Frequency f_i = 0.006 "Zero of the integrator";
  parameter Types.Frequency f_p = 0.8 "First pole";
  parameter Types.Frequency f_r = 2 "Second pole";
  Interfaces.PositionInput o_1 "Read-out of test mass 1";
  Interfaces.PositionInput guidance_o_1 "Set point of o_1, an injected fake read-out";
  Interfaces.ThrustOutput F_x_sc "Commanded thrust";
  Controllers.LeadIntegrator x(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r) "Control law";
equation
  x.e = o_1 - guidance_o_1;
  F_x_sc = m_sc*x.a;
  annotation (Documentation(info = "<html>
<pre>
  F_x_sc = m_sc*K(o_1 - guidance_o_1)
</pre>
<p>A positive read-out asks for a positive thrust: the spacecraft follows test mass 1. Defaults: unity gain as measured
in flight; zeros and poles are a choice.</p>
</html>"));
end DragFreeController;
