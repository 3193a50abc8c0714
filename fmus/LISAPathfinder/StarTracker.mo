within LISAPathfinder;
model StarTracker "The star tracker: attitude with respect to J2000, small angles"
  input Types.Angle Theta "Attitude of the spacecraft about x";
  input Types.Angle Eta "Attitude of the spacecraft about y";
  input Types.Angle Phi "Attitude of the spacecraft about z";
  input Types.Angle n_ast_theta(nominal = 1e-3) "Read-out noise of ast_theta";
  input Types.Angle n_ast_eta(nominal = 1e-3) "Read-out noise of ast_eta";
  input Types.Angle n_ast_phi(nominal = 1e-3) "Read-out noise of ast_phi";
  output Types.Angle ast_theta(nominal = 1e-3) "Read-out of the attitude about x";
  output Types.Angle ast_eta(nominal = 1e-3) "Read-out of the attitude about y";
  output Types.Angle ast_phi(nominal = 1e-3) "Read-out of the attitude about z";
equation
  ast_theta = Theta + n_ast_theta;
  ast_eta = Eta + n_ast_eta;
  ast_phi = Phi + n_ast_phi;
end StarTracker;
