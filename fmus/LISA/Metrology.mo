within LISA;
model Metrology "Interferometers to the test masses, and wavefront sensing of test masses and of the incoming beams"
  extends Icons.Sensor;
  parameter Types.Angle half_opening = Constants.pi/6 "Half of the nominal angle between the assemblies";
  parameter Types.Ratio o_per_y_1 = 0 "Cross-talk of y_1 into o_1";
  parameter Types.Ratio o_per_y_2 = 0 "Cross-talk of y_2 into o_2";
  parameter Types.Ratio o_per_z_1 = 0 "Cross-talk of z_1 into o_1";
  parameter Types.Ratio o_per_z_2 = 0 "Cross-talk of z_2 into o_2";
  parameter Real o_per_eta_1(unit = "m/rad") = 0 "Cross-talk of eta_1 into o_1";
  parameter Real o_per_eta_2(unit = "m/rad") = 0 "Cross-talk of eta_2 into o_2";
  parameter Real o_per_phi_1(unit = "m/rad") = 0 "Cross-talk of phi_1 into o_1";
  parameter Real o_per_phi_2(unit = "m/rad") = 0 "Cross-talk of phi_2 into o_2";
  parameter Types.Ratio dws_gain = 1 "Read-out over true angle of the incoming beams";
  Interfaces.PositionInput x_1 "Position of test mass 1 along x_1";
  Interfaces.PositionInput y_1 "Position of test mass 1 along y_1";
  Interfaces.PositionInput z_1 "Position of test mass 1 along z_1";
  Interfaces.AngleInput eta_1 "Angle of test mass 1 about y_1";
  Interfaces.AngleInput phi_1 "Angle of test mass 1 about z_1";
  Interfaces.AngleInput yaw_1 "Yaw of assembly 1, from its nominal direction";
  Interfaces.PositionInput x_2 "Position of test mass 2 along x_2";
  Interfaces.PositionInput y_2 "Position of test mass 2 along y_2";
  Interfaces.PositionInput z_2 "Position of test mass 2 along z_2";
  Interfaces.AngleInput eta_2 "Angle of test mass 2 about y_2";
  Interfaces.AngleInput phi_2 "Angle of test mass 2 about z_2";
  Interfaces.AngleInput yaw_2 "Yaw of assembly 2, from its nominal direction";
  Interfaces.AngleInput Theta "Attitude of the spacecraft about x";
  Interfaces.AngleInput Eta "Attitude of the spacecraft about y";
  Interfaces.AngleInput Phi "Attitude of the spacecraft about z";
  Interfaces.PositionInput n_1(nominal = 1e-12) "Read-out noise of o_1";
  Interfaces.PositionInput n_2(nominal = 1e-12) "Read-out noise of o_2";
  Interfaces.AngleInput n_eta_1(nominal = 1e-10) "Read-out noise of o_eta_1";
  Interfaces.AngleInput n_phi_1(nominal = 1e-10) "Read-out noise of o_phi_1";
  Interfaces.AngleInput n_eta_2(nominal = 1e-10) "Read-out noise of o_eta_2";
  Interfaces.AngleInput n_phi_2(nominal = 1e-10) "Read-out noise of o_phi_2";
  Interfaces.AngleInput n_dws_eta_1(nominal = 1e-10) "Read-out noise of dws_eta_1";
  Interfaces.AngleInput n_dws_phi_1(nominal = 1e-10) "Read-out noise of dws_phi_1";
  Interfaces.AngleInput n_dws_eta_2(nominal = 1e-10) "Read-out noise of dws_eta_2";
  Interfaces.AngleInput n_dws_phi_2(nominal = 1e-10) "Read-out noise of dws_phi_2";
  Interfaces.PositionOutput o_1 "Read-out of test mass 1 along x_1, against its assembly";
  Interfaces.PositionOutput o_2 "Read-out of test mass 2 along x_2, against its assembly";
  Interfaces.AngleOutput o_eta_1 "Angle of test mass 1 about y_1, by wavefront sensing";
  Interfaces.AngleOutput o_phi_1 "Angle of test mass 1 about z_1, by wavefront sensing";
  Interfaces.AngleOutput o_eta_2 "Angle of test mass 2 about y_2, by wavefront sensing";
  Interfaces.AngleOutput o_phi_2 "Angle of test mass 2 about z_2, by wavefront sensing";
  Interfaces.AngleOutput dws_eta_1 "Angle of assembly 1 about y_1 against the incoming beam";
  Interfaces.AngleOutput dws_phi_1 "Angle of assembly 1 about z_1 against the incoming beam";
  Interfaces.AngleOutput dws_eta_2 "Angle of assembly 2 about y_2 against the incoming beam";
  Interfaces.AngleOutput dws_phi_2 "Angle of assembly 2 about z_2 against the incoming beam";
  Interfaces.AngleOutput mosa_1 "Yaw of assembly 1, by the encoder of its mechanism";
  Interfaces.AngleOutput mosa_2 "Yaw of assembly 2, by the encoder of its mechanism";
  Interfaces.PositionOutput jitter_x_1 "True position of test mass 1 along x_1";
  Interfaces.PositionOutput jitter_x_2 "True position of test mass 2 along x_2";
  Interfaces.AngleOutput jitter_theta "True attitude of the spacecraft about x";
  Interfaces.AngleOutput jitter_eta "True attitude of the spacecraft about y";
  Interfaces.AngleOutput jitter_phi "True attitude of the spacecraft about z";
equation
  o_1 = x_1 + o_per_y_1*y_1 + o_per_z_1*z_1 + o_per_eta_1*eta_1 + o_per_phi_1*phi_1 + n_1;
  o_2 = x_2 + o_per_y_2*y_2 + o_per_z_2*z_2 + o_per_eta_2*eta_2 + o_per_phi_2*phi_2 + n_2;
  o_eta_1 = eta_1 + n_eta_1;
  o_phi_1 = phi_1 + n_phi_1;
  o_eta_2 = eta_2 + n_eta_2;
  o_phi_2 = phi_2 + n_phi_2;
  dws_eta_1 = dws_gain*(cos(half_opening)*Eta - sin(half_opening)*Theta) + n_dws_eta_1;
  dws_phi_1 = dws_gain*(Phi + yaw_1) + n_dws_phi_1;
  dws_eta_2 = dws_gain*(cos(half_opening)*Eta + sin(half_opening)*Theta) + n_dws_eta_2;
  dws_phi_2 = dws_gain*(Phi + yaw_2) + n_dws_phi_2;
  {mosa_1, mosa_2} = {yaw_1, yaw_2};
  {jitter_x_1, jitter_x_2} = {x_1, x_2};
  {jitter_theta, jitter_eta, jitter_phi} = {Theta, Eta, Phi};
  annotation (Documentation(info = "<html>
<pre>
  o_j       = x_j + o_per_y_j*y_j + o_per_z_j*z_j + o_per_eta_j*eta_j + o_per_phi_j*phi_j + n_j
  o_eta_j   = eta_j + n_eta_j,   o_phi_j = phi_j + n_phi_j                               test mass against its housing
  dws_eta_j = dws_gain*(cos(a_j)*Eta - sin(a_j)*Theta) + n_dws_eta_j                     a_1 = half_opening = -a_2
  dws_phi_j = dws_gain*(Phi + yaw_j) + n_dws_phi_j
  mosa_j    = yaw_j
</pre>
<p>The test-mass interferometers read x_j positive. Wavefront sensing of the incoming beams gives the attitude of
assembly j in inertial space with the signs of lisainstrument: the far spacecraft tilts the wavefront by less than
40 frad/nrad, so that only the local motion counts. The encoder has no noise (choice). jitter_ is the true motion, for
the record.</p>
<p>Defaults: the opening as in lisainstrument, no cross-talk.</p>
</html>"));
end Metrology;
