within LISA;
model DragFreeControl "The thrusters make the spacecraft follow both test masses along their axes"
  extends Icons.Controller;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Mass m_sc = 1500 "Mass of the spacecraft";
  parameter Types.Angle half_opening = Constants.pi/6 "Half of the nominal angle between the assemblies";
  parameter Types.Ratio fall_back = 0 "0 in science mode, 1 if test mass 2 is suspended along x_2";
  parameter Types.Frequency f_u = 0.08 "Along x_1: unity gain of the nominal loop";
  parameter Types.Frequency f_z = 0.03 "Along x_1: lead zero";
  parameter Types.Frequency f_i = 0.006 "Along x_1: zero of the integrator";
  parameter Types.Frequency f_p = 0.8 "Along x_1: first pole";
  parameter Types.Frequency f_r = 2 "Along x_1: second pole";
  parameter Types.Frequency f_u_plane = 0.08 "In the plane beside x_1: unity gain of the nominal loop";
  parameter Types.Frequency f_z_plane = 0.03 "In the plane beside x_1: lead zero";
  parameter Types.Frequency f_i_plane = 0.006 "In the plane beside x_1: zero of the integrator";
  parameter Types.Frequency f_p_plane = 0.8 "In the plane beside x_1: first pole";
  parameter Types.Frequency f_r_plane = 2 "In the plane beside x_1: second pole";
  parameter Types.Frequency f_u_z = 0.03 "Along z: unity gain of the nominal loop";
  parameter Types.Frequency f_z_z = 0.009 "Along z: lead zero";
  parameter Types.Frequency f_i_z = 0.0018 "Along z: zero of the integrator";
  parameter Types.Frequency f_p_z = 0.24 "Along z: first pole";
  parameter Types.Frequency f_r_z = 0.6 "Along z: second pole";
  Interfaces.PositionInput o_1 "Read-out of test mass 1";
  Interfaces.PositionInput o_2 "Read-out of test mass 2";
  Interfaces.PositionInput guidance_o_1 "Set point of o_1";
  Interfaces.PositionInput guidance_o_2 "Set point of o_2";
  Interfaces.PositionInput grs_y_1 "Read-out of test mass 1 along y_1";
  Interfaces.PositionInput guidance_y_1 "Set point of grs_y_1";
  Interfaces.PositionInput grs_z_1 "Read-out of test mass 1 along z";
  Interfaces.PositionInput grs_z_2 "Read-out of test mass 2 along z";
  Interfaces.ThrustOutput F_x_sc "Commanded thrust along x";
  Interfaces.ThrustOutput F_y_sc "Commanded thrust along y";
  Interfaces.ThrustOutput F_z_sc "Commanded thrust along z";
  Controllers.LeadIntegrator x_1(h = h, f_u = f_u, f_z = f_z, f_i = f_i, f_p = f_p, f_r = f_r) "Control law along x_1";
  Controllers.LeadIntegrator plane(h = h, f_u = f_u_plane, f_z = f_z_plane, f_i = f_i_plane, f_p = f_p_plane,
    f_r = f_r_plane) "Control law along x_2, in the fall-back along y_1";
  Controllers.LeadIntegrator z(h = h, f_u = f_u_z, f_z = f_z_z, f_i = f_i_z, f_p = f_p_z, f_r = f_r_z)
    "Control law along z";
protected
  final parameter Types.Ratio c = cos(half_opening) "Cosine of the direction of x_1";
  final parameter Types.Ratio s = sin(half_opening) "Sine of the direction of x_1";
  final parameter Types.Ratio U[2,2] = (1 - fall_back)*{{1/(2*c), 1/(2*c)}, {1/(2*s), -1/(2*s)}}
    + fall_back*{{c, -s}, {s, c}} "From demands along x_1 and x_2, in the fall-back along x_1 and y_1, to x and y";
equation
  x_1.e = o_1 - guidance_o_1;
  plane.e = (1 - fall_back)*(o_2 - guidance_o_2) + fall_back*(grs_y_1 - guidance_y_1);
  z.e = (grs_z_1 + grs_z_2)/2;
  F_x_sc = m_sc*(U[1, 1]*x_1.a + U[1, 2]*plane.a);
  F_y_sc = m_sc*(U[2, 1]*x_1.a + U[2, 2]*plane.a);
  F_z_sc = m_sc*z.a;
  annotation (Documentation(info = "<html>
<pre>
  a_1 = K(o_1 - guidance_o_1),   a_2 = K(o_2 - guidance_o_2),   a_z = K((grs_z_1 + grs_z_2)/2)
  F_x_sc = m_sc*(a_1 + a_2)/(2*cos(half_opening)),   F_y_sc = m_sc*(a_1 - a_2)/(2*sin(half_opening))
</pre>
<p>so that the accelerations along x_1 and x_2 are a_1 and a_2: both test masses are drag-free along their axes by
thrust alone. A positive read-out asks for a positive acceleration: the spacecraft follows. Torques of the thrusters
also move the housings; the forces do not anticipate that.</p>
<p>In the fall-back one link is lost and test mass 2 is suspended along x_2. The thrust that is free follows test mass 1
along y_1 by its capacitive read-out, in the place of its suspension: a_2 = K(grs_y_1 - guidance_y_1), and (F_x_sc,
F_y_sc) is m_sc*(a_1, a_2) turned by half_opening.</p>
<p>Defaults: unity gains, zeros and poles of LISA Pathfinder, along x and beyond x; for LISA a choice.</p>
</html>"));
end DragFreeControl;
