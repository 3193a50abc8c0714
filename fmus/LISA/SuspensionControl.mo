within LISA;
model SuspensionControl "Electrostatic forces and torques hold what the thrusters do not follow"
  extends Icons.Controller;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Mass m_tm = 1.928 "Mass of each test mass";
  parameter Types.Inertia I_tm = 6.80e-4 "Inertia of each test mass";
  parameter Types.Ratio fall_back = 0 "0 in science mode, 1 if test mass 2 is suspended along x_2";
  parameter Types.Frequency f_u_plane = 2e-3 "Along y_1, in the fall-back along x_2: unity gain of the nominal loop";
  parameter Types.Frequency f_z_plane = 0.6e-3 "Along y_1, in the fall-back along x_2: lead zero";
  parameter Types.Frequency f_i_plane = 0.12e-3 "Along y_1, in the fall-back along x_2: zero of the integrator";
  parameter Types.Frequency f_p_plane = 12e-3 "Along y_1, in the fall-back along x_2: first pole";
  parameter Types.Frequency f_r_plane = 60e-3 "Along y_1, in the fall-back along x_2: second pole";
  parameter Types.Frequency f_u = 2e-3 "Other positions: unity gain of the nominal loop";
  parameter Types.Frequency f_z = 0.6e-3 "Other positions: lead zero";
  parameter Types.Frequency f_i = 0.12e-3 "Other positions: zero of the integrator";
  parameter Types.Frequency f_p = 12e-3 "Other positions: first pole";
  parameter Types.Frequency f_r = 60e-3 "Other positions: second pole";
  parameter Types.Frequency f_u_rot = 2e-3 "Angles: unity gain of the nominal loop";
  parameter Types.Frequency f_z_rot = 0.6e-3 "Angles: lead zero";
  parameter Types.Frequency f_i_rot = 0.12e-3 "Angles: zero of the integrator";
  parameter Types.Frequency f_p_rot = 12e-3 "Angles: first pole";
  parameter Types.Frequency f_r_rot = 60e-3 "Angles: second pole";
  Interfaces.PositionInput o_2 "Read-out of test mass 2 along x_2";
  Interfaces.PositionInput guidance_o_2 "Set point of o_2";
  Interfaces.PositionInput grs_y_1 "Read-out of test mass 1 along y_1";
  Interfaces.PositionInput grs_y_2 "Read-out of test mass 2 along y_2";
  Interfaces.PositionInput grs_z_1 "Read-out of test mass 1 along z_1";
  Interfaces.PositionInput grs_z_2 "Read-out of test mass 2 along z_2";
  Interfaces.PositionInput guidance_y_1 "Set point of grs_y_1";
  Interfaces.PositionInput guidance_y_2 "Set point of grs_y_2";
  Interfaces.PositionInput guidance_z "Set point of (grs_z_2 - grs_z_1)/2";
  Interfaces.AngleInput grs_theta_1 "Angle of test mass 1 about x_1";
  Interfaces.AngleInput o_eta_1 "Angle of test mass 1 about y_1";
  Interfaces.AngleInput o_phi_1 "Angle of test mass 1 about z_1";
  Interfaces.AngleInput grs_theta_2 "Angle of test mass 2 about x_2";
  Interfaces.AngleInput o_eta_2 "Angle of test mass 2 about y_2";
  Interfaces.AngleInput o_phi_2 "Angle of test mass 2 about z_2";
  Interfaces.AngleInput guidance_theta_1 "Set point of grs_theta_1";
  Interfaces.AngleInput guidance_eta_1 "Set point of o_eta_1";
  Interfaces.AngleInput guidance_phi_1 "Set point of o_phi_1";
  Interfaces.AngleInput guidance_theta_2 "Set point of grs_theta_2";
  Interfaces.AngleInput guidance_eta_2 "Set point of o_eta_2";
  Interfaces.AngleInput guidance_phi_2 "Set point of o_phi_2";
  Interfaces.ForceOutput F_control_x_2 "Force demanded on test mass 2 along x_2, zero in science mode";
  Interfaces.ForceOutput F_control_y_1 "Force demanded on test mass 1 along y_1, zero in the fall-back";
  Interfaces.ForceOutput F_control_z_1 "Force demanded on test mass 1 along z_1";
  Interfaces.ForceOutput F_control_y_2 "Force demanded on test mass 2 along y_2";
  Interfaces.ForceOutput F_control_z_2 "Force demanded on test mass 2 along z_2";
  Interfaces.TorqueOutput N_control_theta_1 "Torque demanded on test mass 1 about x_1";
  Interfaces.TorqueOutput N_control_eta_1 "Torque demanded on test mass 1 about y_1";
  Interfaces.TorqueOutput N_control_phi_1 "Torque demanded on test mass 1 about z_1";
  Interfaces.TorqueOutput N_control_theta_2 "Torque demanded on test mass 2 about x_2";
  Interfaces.TorqueOutput N_control_eta_2 "Torque demanded on test mass 2 about y_2";
  Interfaces.TorqueOutput N_control_phi_2 "Torque demanded on test mass 2 about z_2";
  Controllers.LeadIntegrator plane(h = h, f_u = f_u_plane, f_z = f_z_plane, f_i = f_i_plane, f_p = f_p_plane,
    f_r = f_r_plane) "Control law along y_1, in the fall-back along x_2";
  Controllers.LeadIntegrator y_2(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r) "Control law along y_2";
  Controllers.LeadIntegrator z(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r)
    "Control law of half the difference along z";
  Controllers.AngularLeadIntegrator theta_1(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot, f_p = f_p_rot,
    f_r = f_r_rot) "Control law of test mass 1 about x_1";
  Controllers.AngularLeadIntegrator eta_1(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot, f_p = f_p_rot,
    f_r = f_r_rot) "Control law of test mass 1 about y_1";
  Controllers.AngularLeadIntegrator phi_1(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot, f_p = f_p_rot,
    f_r = f_r_rot) "Control law of test mass 1 about z_1";
  Controllers.AngularLeadIntegrator theta_2(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot, f_p = f_p_rot,
    f_r = f_r_rot) "Control law of test mass 2 about x_2";
  Controllers.AngularLeadIntegrator eta_2(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot, f_p = f_p_rot,
    f_r = f_r_rot) "Control law of test mass 2 about y_2";
  Controllers.AngularLeadIntegrator phi_2(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot, f_p = f_p_rot,
    f_r = f_r_rot) "Control law of test mass 2 about z_2";
equation
  plane.e = (1 - fall_back)*(grs_y_1 - guidance_y_1) + fall_back*(o_2 - guidance_o_2);
  y_2.e = grs_y_2 - guidance_y_2;
  z.e = (grs_z_2 - grs_z_1)/2 - guidance_z;
  theta_1.e = grs_theta_1 - guidance_theta_1;
  eta_1.e = o_eta_1 - guidance_eta_1;
  phi_1.e = o_phi_1 - guidance_phi_1;
  theta_2.e = grs_theta_2 - guidance_theta_2;
  eta_2.e = o_eta_2 - guidance_eta_2;
  phi_2.e = o_phi_2 - guidance_phi_2;
  F_control_x_2 = -fall_back*m_tm*plane.a;
  F_control_y_1 = -(1 - fall_back)*m_tm*plane.a;
  F_control_y_2 = -m_tm*y_2.a;
  F_control_z_1 = m_tm*z.a;
  F_control_z_2 = -m_tm*z.a;
  N_control_theta_1 = -I_tm*theta_1.a;
  N_control_eta_1 = -I_tm*eta_1.a;
  N_control_phi_1 = -I_tm*phi_1.a;
  N_control_theta_2 = -I_tm*theta_2.a;
  N_control_eta_2 = -I_tm*eta_2.a;
  N_control_phi_2 = -I_tm*phi_2.a;
  annotation (Documentation(info = "<html>
<pre>
  F_control_y_j   = -m_tm*K(grs_y_j - guidance_y_j)
  F_control_z_2   = -m_tm*K((grs_z_2 - grs_z_1)/2 - guidance_z) = -F_control_z_1
  N_control_phi_j = -I_tm*K(o_phi_j - guidance_phi_j)          likewise eta; theta by the capacitive read-out
</pre>
<p>A positive error asks for a negative force or torque. In the fall-back test mass 2 is suspended along x_2,
F_control_x_2 = -m_tm*K(o_2 - guidance_o_2), and the thrusters follow test mass 1 along y_1.</p>
<p>Defaults: those of the angles of LISA Pathfinder; for LISA a choice.</p>
</html>"));
end SuspensionControl;
