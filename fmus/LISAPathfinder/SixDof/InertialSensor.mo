within LISAPathfinder.SixDof;
model InertialSensor "The capacitive read-outs of both test masses, six degrees of freedom each"
  extends Icons.Sensor;
  parameter Types.Ratio grs_gain_y_1 = 1 "Read-out over true position of test mass 1 along y";
  parameter Types.Ratio grs_gain_y_2 = 1 "Read-out over true position of test mass 2 along y";
  parameter Types.Ratio grs_y_per_x_1 = 0 "Cross-talk of x into the read-out of y of test mass 1";
  parameter Types.Ratio grs_y_per_x_2 = 0 "Cross-talk of x into the read-out of y of test mass 2";
  Interfaces.PositionInput x_1 "Position of test mass 1 along x";
  Interfaces.PositionInput y_1 "Position of test mass 1 along y";
  Interfaces.PositionInput z_1 "Position of test mass 1 along z";
  Interfaces.AngleInput theta_1 "Angle of test mass 1 about x";
  Interfaces.AngleInput eta_1 "Angle of test mass 1 about y";
  Interfaces.AngleInput phi_1 "Angle of test mass 1 about z";
  Interfaces.PositionInput x_2 "Position of test mass 2 along x";
  Interfaces.PositionInput y_2 "Position of test mass 2 along y";
  Interfaces.PositionInput z_2 "Position of test mass 2 along z";
  Interfaces.AngleInput theta_2 "Angle of test mass 2 about x";
  Interfaces.AngleInput eta_2 "Angle of test mass 2 about y";
  Interfaces.AngleInput phi_2 "Angle of test mass 2 about z";
  Interfaces.PositionInput n_grs_x_1 "Read-out noise of grs_x_1";
  Interfaces.PositionInput n_grs_y_1 "Read-out noise of grs_y_1";
  Interfaces.PositionInput n_grs_z_1 "Read-out noise of grs_z_1";
  Interfaces.AngleInput n_grs_theta_1 "Read-out noise of grs_theta_1";
  Interfaces.AngleInput n_grs_eta_1 "Read-out noise of grs_eta_1";
  Interfaces.AngleInput n_grs_phi_1 "Read-out noise of grs_phi_1";
  Interfaces.PositionInput n_grs_x_2 "Read-out noise of grs_x_2";
  Interfaces.PositionInput n_grs_y_2 "Read-out noise of grs_y_2";
  Interfaces.PositionInput n_grs_z_2 "Read-out noise of grs_z_2";
  Interfaces.AngleInput n_grs_theta_2 "Read-out noise of grs_theta_2";
  Interfaces.AngleInput n_grs_eta_2 "Read-out noise of grs_eta_2";
  Interfaces.AngleInput n_grs_phi_2 "Read-out noise of grs_phi_2";
  Interfaces.PositionOutput grs_x_1 "Read-out of the position of test mass 1 along x";
  Interfaces.PositionOutput grs_y_1 "Read-out of the position of test mass 1 along y";
  Interfaces.PositionOutput grs_z_1 "Read-out of the position of test mass 1 along z";
  Interfaces.AngleOutput grs_theta_1 "Read-out of the angle of test mass 1 about x";
  Interfaces.AngleOutput grs_eta_1 "Read-out of the angle of test mass 1 about y";
  Interfaces.AngleOutput grs_phi_1 "Read-out of the angle of test mass 1 about z";
  Interfaces.PositionOutput grs_x_2 "Read-out of the position of test mass 2 along x";
  Interfaces.PositionOutput grs_y_2 "Read-out of the position of test mass 2 along y";
  Interfaces.PositionOutput grs_z_2 "Read-out of the position of test mass 2 along z";
  Interfaces.AngleOutput grs_theta_2 "Read-out of the angle of test mass 2 about x";
  Interfaces.AngleOutput grs_eta_2 "Read-out of the angle of test mass 2 about y";
  Interfaces.AngleOutput grs_phi_2 "Read-out of the angle of test mass 2 about z";
equation
  grs_x_1 = x_1 + n_grs_x_1;
  grs_y_1 = grs_gain_y_1*y_1 + grs_y_per_x_1*x_1 + n_grs_y_1;
  grs_z_1 = z_1 + n_grs_z_1;
  grs_theta_1 = theta_1 + n_grs_theta_1;
  grs_eta_1 = eta_1 + n_grs_eta_1;
  grs_phi_1 = phi_1 + n_grs_phi_1;
  grs_x_2 = x_2 + n_grs_x_2;
  grs_y_2 = grs_gain_y_2*y_2 + grs_y_per_x_2*x_2 + n_grs_y_2;
  grs_z_2 = z_2 + n_grs_z_2;
  grs_theta_2 = theta_2 + n_grs_theta_2;
  grs_eta_2 = eta_2 + n_grs_eta_2;
  grs_phi_2 = phi_2 + n_grs_phi_2;
  annotation (Documentation(info = "<html>
<p>grs_k_j = k_j + n_grs_k_j for k = x, y, z, theta, eta, phi and j = 1, 2: positions and angles of each test mass in
its housing, by capacitive sensing. Along y, grs_y_j = grs_gain_y_j*y_j + grs_y_per_x_j*x_j + n_grs_y_j. Defaults: no
error of the scale, and electrodes in line with the axes.</p>
</html>"));
end InertialSensor;
