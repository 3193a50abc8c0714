within LISAPathfinder.SixDof;
model StarTracker "The star tracker: attitude with respect to J2000, small angles"
  extends Icons.Sensor;
  Interfaces.AngleInput Theta "Attitude of the spacecraft about x";
  Interfaces.AngleInput Eta "Attitude of the spacecraft about y";
  Interfaces.AngleInput Phi "Attitude of the spacecraft about z";
  Interfaces.AngleInput n_ast_theta(nominal = 1e-3) "Read-out noise of ast_theta";
  Interfaces.AngleInput n_ast_eta(nominal = 1e-3) "Read-out noise of ast_eta";
  Interfaces.AngleInput n_ast_phi(nominal = 1e-3) "Read-out noise of ast_phi";
  Interfaces.AngleOutput ast_theta(nominal = 1e-3) "Read-out of the attitude about x";
  Interfaces.AngleOutput ast_eta(nominal = 1e-3) "Read-out of the attitude about y";
  Interfaces.AngleOutput ast_phi(nominal = 1e-3) "Read-out of the attitude about z";
equation
  ast_theta = Theta + n_ast_theta;
  ast_eta = Eta + n_ast_eta;
  ast_phi = Phi + n_ast_phi;
  annotation (Documentation(info = "<html>
<p>ast_k = k + n_ast_k: small angles of the spacecraft with respect to J2000.</p>
</html>"));
end StarTracker;
