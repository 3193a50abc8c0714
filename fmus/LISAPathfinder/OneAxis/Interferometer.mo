within LISAPathfinder.OneAxis;
model Interferometer "The two interferometers along x"
  extends Icons.Sensor;
  parameter Types.Ratio delta_ifo = -2.2e-5 "Cross-talk of x_1 into the differential read-out";
  Interfaces.PositionInput x_1 "Position of test mass 1";
  Interfaces.PositionInput x_2 "Position of test mass 2";
  Interfaces.PositionInput n_1(nominal = 1e-13) "Read-out noise of o_1";
  Interfaces.PositionInput n_12(nominal = 1e-13) "Read-out noise of o_12";
  Interfaces.PositionOutput o_1 "Read-out of test mass 1 against the spacecraft";
  Interfaces.PositionOutput o_12 "Read-out of test mass 2 against test mass 1";
equation
  o_1 = x_1 + n_1;
  o_12 = x_2 - x_1 + delta_ifo*x_1 + n_12;
  annotation (Documentation(info = "<html>
<pre>
  o_1 = x_1 + n_1,   o_12 = x_2 - x_1 + delta_ifo*x_1 + n_12
</pre>
<p>Default: delta_ifo of the first alignment epoch in Phys. Rev. D 97, 122002 (2018).</p>
</html>"));
end Interferometer;
