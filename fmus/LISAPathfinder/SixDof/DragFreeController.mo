within LISAPathfinder.SixDof;
model DragFreeController "The thrusters make the spacecraft follow the test masses in six degrees of freedom"
  extends Icons.Controller;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Mass m_sc = 422.7 "Mass of the spacecraft";
  parameter Types.Inertia I_xx_sc = 202.5 "Inertia of the spacecraft about x";
  parameter Types.Inertia I_yy_sc = 209.7 "Inertia of the spacecraft about y";
  parameter Types.Inertia I_zz_sc = 191.7 "Inertia of the spacecraft about z";
  parameter Types.Length d = 0.376 "Distance of the test masses";
  parameter Types.Frequency f_u = 0.08 "Along x: unity gain of the nominal loop";
  parameter Types.Frequency f_z = 0.03 "Along x: lead zero";
  parameter Types.Frequency f_i = 0.006 "Along x: zero of the integrator";
  parameter Types.Frequency f_p = 0.8 "Along x: first pole";
  parameter Types.Frequency f_r = 2 "Along x: second pole";
  parameter Types.Frequency f_u_rot = 0.03 "Other degrees of freedom: unity gain of the nominal loop";
  parameter Types.Frequency f_z_rot = 0.009 "Other degrees of freedom: lead zero";
  parameter Types.Frequency f_i_rot = 0.0018 "Other degrees of freedom: zero of the integrator";
  parameter Types.Frequency f_p_rot = 0.24 "Other degrees of freedom: first pole";
  parameter Types.Frequency f_r_rot = 0.6 "Other degrees of freedom: second pole";
  Interfaces.PositionInput o_1 "Read-out of test mass 1";
  Interfaces.PositionInput guidance_o_1 "Set point of o_1, an injected fake read-out";
  Interfaces.PositionInput grs_y_1 "Read-out of test mass 1 along y";
  Interfaces.PositionInput grs_y_2 "Read-out of test mass 2 along y";
  Interfaces.PositionInput grs_z_1 "Read-out of test mass 1 along z";
  Interfaces.PositionInput grs_z_2 "Read-out of test mass 2 along z";
  Interfaces.AngleInput grs_theta_1 "Read-out of test mass 1 about x";
  Interfaces.ThrustOutput F_x_sc "Commanded thrust along x";
  Interfaces.ThrustOutput F_y_sc "Commanded thrust along y";
  Interfaces.ThrustOutput F_z_sc "Commanded thrust along z";
  Interfaces.ThrustTorqueOutput N_x_sc "Commanded torque of the thrusters about x";
  Interfaces.ThrustTorqueOutput N_y_sc "Commanded torque of the thrusters about y";
  Interfaces.ThrustTorqueOutput N_z_sc "Commanded torque of the thrusters about z";
  Controllers.LeadIntegrator x(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r) "Control law along x";
  Controllers.LeadIntegrator y(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot, f_p = f_p_rot, f_r = f_r_rot)
    "Control law along y";
  Controllers.LeadIntegrator z(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot, f_p = f_p_rot, f_r = f_r_rot)
    "Control law along z";
  Controllers.AngularLeadIntegrator theta(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot,
    f_p = f_p_rot, f_r = f_r_rot) "Control law about x";
  Controllers.AngularLeadIntegrator eta(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot,
    f_p = f_p_rot, f_r = f_r_rot) "Control law about y";
  Controllers.AngularLeadIntegrator phi(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot,
    f_p = f_p_rot, f_r = f_r_rot) "Control law about z";
equation
  x.e = o_1 - guidance_o_1;
  y.e = (grs_y_1 + grs_y_2)/2;
  z.e = (grs_z_1 + grs_z_2)/2;
  theta.e = grs_theta_1;
  eta.e = (grs_z_1 - grs_z_2)/d;
  phi.e = (grs_y_2 - grs_y_1)/d;
  F_x_sc = m_sc*x.a;
  F_y_sc = m_sc*y.a;
  F_z_sc = m_sc*z.a;
  N_x_sc = I_xx_sc*theta.a;
  N_y_sc = I_yy_sc*eta.a;
  N_z_sc = I_zz_sc*phi.a;
  annotation (Documentation(info = "<html>
<p>Laws K of the errors x = o_1 - guidance_o_1, means of y and z, theta of test mass 1, and the turns of the line
through both test masses, eta = (z_1 - z_2)/d and phi = (y_2 - y_1)/d. A positive error asks for a positive thrust or
torque: the spacecraft follows.</p>
<p>Defaults: unity gain along x as measured in flight; all other values are a choice.</p>
</html>"));
end DragFreeController;
