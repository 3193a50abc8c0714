within LISAPathfinder.SixDof;
model Interferometer "The interferometers: x, phi and eta; jitter of the spacecraft couples into o_12"
  extends Icons.Sensor;
  parameter Types.Ratio delta_ifo = -2.2e-5 "Cross-talk of x_1 into the differential read-out";
  parameter Real b_1(unit = "m/rad") = 0 "Cross-coupling of the mean of phi_1 and phi_2";
  parameter Real b_2(unit = "m/rad") = 0 "Cross-coupling of the mean of eta_1 and eta_2";
  parameter Types.Ratio b_3 = 0 "Cross-coupling of the mean of y_1 and y_2";
  parameter Types.Ratio b_4 = 0 "Cross-coupling of the mean of z_1 and z_2";
  Interfaces.PositionInput x_1 "Position of test mass 1 along x";
  Interfaces.PositionInput x_2 "Position of test mass 2 along x";
  Interfaces.PositionInput y_1 "Position of test mass 1 along y";
  Interfaces.PositionInput y_2 "Position of test mass 2 along y";
  Interfaces.PositionInput z_1 "Position of test mass 1 along z";
  Interfaces.PositionInput z_2 "Position of test mass 2 along z";
  Interfaces.AngleInput eta_1 "Angle of test mass 1 about y";
  Interfaces.AngleInput eta_2 "Angle of test mass 2 about y";
  Interfaces.AngleInput phi_1 "Angle of test mass 1 about z";
  Interfaces.AngleInput phi_2 "Angle of test mass 2 about z";
  Interfaces.PositionInput n_1(nominal = 1e-13) "Read-out noise of o_1";
  Interfaces.PositionInput n_12(nominal = 1e-13) "Read-out noise of o_12";
  Interfaces.AngleInput n_phi_1(nominal = 1e-10) "Read-out noise of o_phi_1";
  Interfaces.AngleInput n_phi_12(nominal = 1e-10) "Read-out noise of o_phi_12";
  Interfaces.AngleInput n_eta_1(nominal = 1e-10) "Read-out noise of o_eta_1";
  Interfaces.AngleInput n_eta_12(nominal = 1e-10) "Read-out noise of o_eta_12";
  Interfaces.PositionOutput o_1 "Read-out of test mass 1 against the spacecraft";
  Interfaces.PositionOutput o_12 "Read-out of test mass 2 against test mass 1";
  Interfaces.AngleOutput o_phi_1 "Angle of test mass 1 about z, by wavefront sensing";
  Interfaces.AngleOutput o_phi_12 "Angle of test mass 2 against test mass 1 about z";
  Interfaces.AngleOutput o_eta_1 "Angle of test mass 1 about y, by wavefront sensing";
  Interfaces.AngleOutput o_eta_12 "Angle of test mass 2 against test mass 1 about y";
  Types.Position bump "Jitter of the spacecraft in the differential read-out";
equation
  bump = b_1*(phi_1 + phi_2)/2 + b_2*(eta_1 + eta_2)/2 + b_3*(y_1 + y_2)/2 + b_4*(z_1 + z_2)/2;
  o_1 = x_1 + n_1;
  o_12 = x_2 - x_1 + delta_ifo*x_1 - bump + n_12;
  o_phi_1 = phi_1 + n_phi_1;
  o_phi_12 = phi_2 - phi_1 + n_phi_12;
  o_eta_1 = eta_1 + n_eta_1;
  o_eta_12 = eta_2 - eta_1 + n_eta_12;
  annotation (Documentation(info = "<html>
<pre>
  o_1     = x_1 + n_1
  o_12    = x_2 - x_1 + delta_ifo*x_1 - bump + n_12
  bump    = b_1*mean(phi_j) + b_2*mean(eta_j) + b_3*mean(y_j) + b_4*mean(z_j)
  o_phi_1 = phi_1 + n_phi_1,   o_phi_12 = phi_2 - phi_1 + n_phi_12,   likewise eta
</pre>
<p>Default: delta_ifo of the first alignment epoch in Phys. Rev. D 97, 122002 (2018); no cross-talk.</p>
</html>"));
end Interferometer;
