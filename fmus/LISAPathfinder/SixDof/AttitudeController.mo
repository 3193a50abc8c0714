within LISAPathfinder.SixDof;
model AttitudeController "The star tracker steers the test masses; the thrusters turn the spacecraft after them"
  extends Icons.Controller;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Mass m_tm = 1.928 "Mass of each test mass";
  parameter Types.Inertia I_tm = 6.80e-4 "Inertia of each test mass";
  parameter Types.Length d = 0.376 "Distance of the test masses";
  parameter Types.Frequency f_u = 0.07e-3 "Unity gain of the nominal loop";
  parameter Types.Frequency f_z = 0.021e-3 "Zero";
  parameter Types.Frequency f_p = 0.42e-3 "Pole, threefold";
  Interfaces.AngleInput ast_theta(nominal = 1e-3) "Read-out of the attitude about x";
  Interfaces.AngleInput ast_eta(nominal = 1e-3) "Read-out of the attitude about y";
  Interfaces.AngleInput ast_phi(nominal = 1e-3) "Read-out of the attitude about z";
  Interfaces.AngleInput attitude_theta(nominal = 1e-3) "Set point of the attitude about x";
  Interfaces.AngleInput attitude_eta(nominal = 1e-3) "Set point of the attitude about y";
  Interfaces.AngleInput attitude_phi(nominal = 1e-3) "Set point of the attitude about z";
  Interfaces.ForceOutput F_control_y_1 "Force demanded on test mass 1 along y";
  Interfaces.ForceOutput F_control_z_1 "Force demanded on test mass 1 along z";
  Interfaces.ForceOutput F_control_y_2 "Force demanded on test mass 2 along y";
  Interfaces.ForceOutput F_control_z_2 "Force demanded on test mass 2 along z";
  Interfaces.TorqueOutput N_control_theta_1 "Torque demanded on test mass 1 about x";
  Controllers.LeadTripleLag theta(h = h, f_u = f_u, f_z = f_z, f_p = f_p) "Control law about x";
  Controllers.LeadTripleLag eta(h = h, f_u = f_u, f_z = f_z, f_p = f_p) "Control law about y";
  Controllers.LeadTripleLag phi(h = h, f_u = f_u, f_z = f_z, f_p = f_p) "Control law about z";
equation
  theta.e = ast_theta - attitude_theta;
  eta.e = ast_eta - attitude_eta;
  phi.e = ast_phi - attitude_phi;
  // A turn by phi takes test mass 2 along y and test mass 1 against it; a turn by eta likewise against z.
  N_control_theta_1 = -I_tm*theta.a;
  F_control_y_1 = m_tm*d/2*phi.a;
  F_control_y_2 = -m_tm*d/2*phi.a;
  F_control_z_1 = -m_tm*d/2*eta.a;
  F_control_z_2 = m_tm*d/2*eta.a;
  annotation (Documentation(info = "<html>
<p>The star tracker does not command the thrusters. Its attitude error moves the test masses by differential forces
along y and z and by a torque about x on test mass 1; the drag-free control turns the spacecraft after them. Laws L of
ast_k - attitude_k.</p>
<p>Defaults: a choice.</p>
</html>"));
end AttitudeController;
