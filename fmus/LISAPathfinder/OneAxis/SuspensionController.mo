within LISAPathfinder.OneAxis;
model SuspensionController "Electrostatic forces make test mass 2 follow test mass 1 along x"
  extends Icons.Controller;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Frequency f_u = 1e-3 "Unity gain of the nominal loop";
  parameter Types.Frequency f_z = 0.3e-3 "Lead zero";
  parameter Types.Frequency f_i = 0.06e-3 "Zero of the integrator";
  parameter Types.Frequency f_p = 6e-3 "First pole";
  parameter Types.Frequency f_r = 30e-3 "Second pole";
  parameter Types.Acceleration f_x_2_start = 0 "Force per unit mass demanded at zero error";
  Interfaces.PositionInput o_12 "Differential read-out";
  Interfaces.PositionInput guidance_o_12 "Set point of o_12, an injected fake read-out";
  Interfaces.AccelerationOutput f_control_2 "Force per unit mass demanded on test mass 2";
  Controllers.LeadIntegrator x(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r) "Control law";
equation
  x.e = o_12 - guidance_o_12;
  f_control_2 = f_x_2_start - x.a;
  annotation (Documentation(info = "<html>
<pre>
  f_control_2 = f_x_2_start - K(o_12 - guidance_o_12)
</pre>
<p>A positive read-out asks for a negative force on test mass 2. Defaults: unity gain near 1 mHz as in flight; zeros
and poles are a choice.</p>
</html>"));
end SuspensionController;
