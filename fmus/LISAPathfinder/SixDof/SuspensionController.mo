within LISAPathfinder.SixDof;
model SuspensionController "Electrostatic forces and torques hold test mass 2 along x and the angles of both"
  extends Icons.Controller;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Inertia I_tm = 6.80e-4 "Inertia of each test mass";
  parameter Types.Acceleration f_x_2_start = 0 "Force per unit mass demanded at zero error";
  parameter Types.Frequency f_u = 1e-3 "Along x: unity gain of the nominal loop";
  parameter Types.Frequency f_z = 0.3e-3 "Along x: lead zero";
  parameter Types.Frequency f_i = 0.06e-3 "Along x: zero of the integrator";
  parameter Types.Frequency f_p = 6e-3 "Along x: first pole";
  parameter Types.Frequency f_r = 30e-3 "Along x: second pole";
  parameter Types.Frequency f_u_rot = 2e-3 "Angles: unity gain of the nominal loop";
  parameter Types.Frequency f_z_rot = 0.6e-3 "Angles: lead zero";
  parameter Types.Frequency f_i_rot = 0.12e-3 "Angles: zero of the integrator";
  parameter Types.Frequency f_p_rot = 12e-3 "Angles: first pole";
  parameter Types.Frequency f_r_rot = 60e-3 "Angles: second pole";
  Interfaces.PositionInput o_12 "Differential read-out";
  Interfaces.PositionInput guidance_o_12 "Set point of o_12, an injected fake read-out";
  Interfaces.AngleInput o_phi_1 "Angle of test mass 1 about z";
  Interfaces.AngleInput o_phi_12 "Angle of test mass 2 against test mass 1 about z";
  Interfaces.AngleInput o_eta_1 "Angle of test mass 1 about y";
  Interfaces.AngleInput o_eta_12 "Angle of test mass 2 against test mass 1 about y";
  Interfaces.AngleInput grs_theta_2 "Angle of test mass 2 about x";
  Interfaces.AccelerationOutput f_control_2 "Force per unit mass demanded on test mass 2 along x";
  Interfaces.TorqueOutput N_control_eta_1 "Torque demanded on test mass 1 about y";
  Interfaces.TorqueOutput N_control_phi_1 "Torque demanded on test mass 1 about z";
  Interfaces.TorqueOutput N_control_theta_2 "Torque demanded on test mass 2 about x";
  Interfaces.TorqueOutput N_control_eta_2 "Torque demanded on test mass 2 about y";
  Interfaces.TorqueOutput N_control_phi_2 "Torque demanded on test mass 2 about z";
  Controllers.LeadIntegrator x(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r) "Control law along x";
  Controllers.AngularLeadIntegrator eta_1(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot,
    f_p = f_p_rot, f_r = f_r_rot) "Control law of test mass 1 about y";
  Controllers.AngularLeadIntegrator phi_1(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot,
    f_p = f_p_rot, f_r = f_r_rot) "Control law of test mass 1 about z";
  Controllers.AngularLeadIntegrator theta_2(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot,
    f_p = f_p_rot, f_r = f_r_rot) "Control law of test mass 2 about x";
  Controllers.AngularLeadIntegrator eta_2(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot,
    f_p = f_p_rot, f_r = f_r_rot) "Control law of test mass 2 about y";
  Controllers.AngularLeadIntegrator phi_2(h = h, f_u = f_u_rot, f_z = f_z_rot, f_i = f_i_rot,
    f_p = f_p_rot, f_r = f_r_rot) "Control law of test mass 2 about z";
equation
  x.e = o_12 - guidance_o_12;
  eta_1.e = o_eta_1;
  phi_1.e = o_phi_1;
  theta_2.e = grs_theta_2;
  eta_2.e = o_eta_1 + o_eta_12;
  phi_2.e = o_phi_1 + o_phi_12;
  f_control_2 = f_x_2_start - x.a;
  N_control_eta_1 = -I_tm*eta_1.a;
  N_control_phi_1 = -I_tm*phi_1.a;
  N_control_theta_2 = -I_tm*theta_2.a;
  N_control_eta_2 = -I_tm*eta_2.a;
  N_control_phi_2 = -I_tm*phi_2.a;
  annotation (Documentation(info = "<html>
<p>Laws K of o_12 - guidance_o_12 along x, of eta and phi of both test masses, and of theta of test mass 2. A positive
error asks for a negative force or torque.</p>
<p>Defaults: unity gain near 1 mHz along x as in flight; all other values are a choice.</p>
</html>"));
end SuspensionController;
