within LISAPathfinder.Sources;
block Sine "Sine of a set point"
  extends Icons.Source;
  parameter Types.Position amplitude = 10e-9 "Amplitude";
  parameter Types.Frequency f = 0.01 "Frequency";
  Interfaces.PositionOutput y "amplitude*sin(2*pi*f*time)";
equation
  y = amplitude*sin(2*Constants.pi*f*time);
  annotation (Documentation(info = "<html>
<p>A sine from time 0 on. Injections of the campaigns are of this form, for whole cycles.</p>
</html>"));
end Sine;
