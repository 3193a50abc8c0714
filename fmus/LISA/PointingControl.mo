within LISA;
model PointingControl "The thrusters point the spacecraft and the mechanisms the assemblies to the incoming beams"
  extends Icons.Controller;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Inertia I_xx_sc = 900 "Inertia of the spacecraft about x";
  parameter Types.Inertia I_yy_sc = 900 "Inertia of the spacecraft about y";
  parameter Types.Inertia I_zz_sc = 1200 "Inertia of the spacecraft about z";
  parameter Types.Angle half_opening = Constants.pi/6 "Half of the nominal angle between the assemblies";
  parameter Types.Frequency f_u = 0.03 "Attitude: unity gain of the nominal loop";
  parameter Types.Frequency f_z = 0.009 "Attitude: lead zero";
  parameter Types.Frequency f_i = 0.0018 "Attitude: zero of the integrator";
  parameter Types.Frequency f_p = 0.24 "Attitude: first pole";
  parameter Types.Frequency f_r = 0.6 "Attitude: second pole";
  parameter Types.Frequency f_u_opening = 3e-3 "Opening: unity gain; zero locks the assemblies";
  Interfaces.AngleInput dws_eta_1 "Angle of assembly 1 about y_1 against the incoming beam";
  Interfaces.AngleInput dws_phi_1 "Angle of assembly 1 about z_1 against the incoming beam";
  Interfaces.AngleInput dws_eta_2 "Angle of assembly 2 about y_2 against the incoming beam";
  Interfaces.AngleInput dws_phi_2 "Angle of assembly 2 about z_2 against the incoming beam";
  Interfaces.AngleInput guidance_theta "Set point of the attitude about x";
  Interfaces.AngleInput guidance_eta "Set point of the attitude about y";
  Interfaces.AngleInput guidance_phi "Set point of the attitude about z";
  Interfaces.AngleInput guidance_opening "Set point of dws_phi_1 - dws_phi_2";
  Interfaces.ThrustTorqueOutput N_x_sc "Commanded torque of the thrusters about x";
  Interfaces.ThrustTorqueOutput N_y_sc "Commanded torque of the thrusters about y";
  Interfaces.ThrustTorqueOutput N_z_sc "Commanded torque of the thrusters about z";
  Interfaces.AngleOutput mosa_control_1 "Commanded yaw of assembly 1";
  Interfaces.AngleOutput mosa_control_2 "Commanded yaw of assembly 2";
  Controllers.AngularLeadIntegrator theta(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r)
    "Control law about x";
  Controllers.AngularLeadIntegrator eta(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r)
    "Control law about y";
  Controllers.AngularLeadIntegrator phi(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r)
    "Control law about z";
  Integrator opening(h = h, f_u = f_u_opening) "Control law of the opening";
equation
  theta.e = (dws_eta_2 - dws_eta_1)/(2*sin(half_opening)) - guidance_theta;
  eta.e = (dws_eta_1 + dws_eta_2)/(2*cos(half_opening)) - guidance_eta;
  phi.e = (dws_phi_1 + dws_phi_2)/2 - guidance_phi;
  opening.e = dws_phi_1 - dws_phi_2 - guidance_opening;
  N_x_sc = -I_xx_sc*theta.a;
  N_y_sc = -I_yy_sc*eta.a;
  N_z_sc = -I_zz_sc*phi.a;
  mosa_control_1 = (guidance_opening - opening.a)/2;
  mosa_control_2 = -mosa_control_1;
  annotation (Documentation(info = "<html>
<pre>
  N_x_sc = -I_xx_sc*K((dws_eta_2 - dws_eta_1)/(2*sin(half_opening)) - guidance_theta)
  N_y_sc = -I_yy_sc*K((dws_eta_1 + dws_eta_2)/(2*cos(half_opening)) - guidance_eta)
  N_z_sc = -I_zz_sc*K((dws_phi_1 + dws_phi_2)/2 - guidance_phi)
  mosa_control_1 = -mosa_control_2 = (guidance_opening - K(dws_phi_1 - dws_phi_2 - guidance_opening))/2
</pre>
<p>The errors are attitude angles of the spacecraft: a positive one asks for a negative torque. The assemblies turn
against each other, so that their mechanisms hardly turn the spacecraft; they follow the set point of the opening at
once, and an integral law holds it.</p>
<p>Defaults: unity gain, zeros and poles of LISA Pathfinder beyond x; for LISA a choice, as is the opening loop.</p>
</html>"));
end PointingControl;
