within LISA;
model Assembly "Movable optical assembly that turns about z, and the test mass in its housing"
  extends Icons.Body;
  parameter Types.Mass m_tm = 1.928 "Mass of the test mass";
  parameter Types.Inertia I_tm = 6.80e-4 "Inertia of the test mass about any axis";
  parameter Types.Inertia I_mosa = 15 "Inertia of the assembly about its pivot";
  parameter Types.Angle direction = 0 "Nominal direction of x_j from x of the spacecraft";
  parameter Types.Length p[3] = zeros(3) "Location of the pivot, from the centre of the spacecraft";
  parameter Types.Length rho[3] = zeros(3) "Location of the housing from the pivot, in its own axes";
  parameter Types.Stiffness omega2[3] = {-5.5e-7, -1e-6, -1e-6} "Stiffness along x_j, y_j, z_j";
  parameter Types.Stiffness omega2_xy = 0 "Cross stiffness of x_j and y_j";
  parameter Types.Stiffness omega2_rot[3] = fill(-1.5e-6, 3) "Stiffness about x_j, y_j, z_j";
  parameter Types.Frequency f_mosa = 0.5 "Natural frequency of the mechanism";
  parameter Types.Ratio damping_mosa = 0.7 "Damping ratio of the mechanism";
  input Types.Acceleration g[3] "Stray force per unit mass";
  input Types.Force F_applied[3] "Applied electrostatic force";
  input Types.AngularAcceleration gamma[3] "Stray torque per unit inertia";
  input Types.Torque N_applied[3] "Applied electrostatic torque";
  input Types.Angle command "Commanded yaw";
  Interfaces.AccelerationInput a_O[3] "Acceleration of the spacecraft, in its axes";
  Interfaces.AngularVelocityInput Omega[3] "Rate of the spacecraft, in its axes";
  Interfaces.AngularAccelerationInput dOmega[3] "Angular acceleration of the spacecraft, in its axes";
  Interfaces.PositionOutput r[3] "Position of the test mass from the pivot, in axes of the spacecraft";
  Interfaces.ForceOutput F[3] "Force of the spacecraft on the test mass, in its axes";
  Interfaces.TorqueOutput N[3] "Torque of the spacecraft on test mass and assembly, in its axes";
  Types.Angle yaw(start = 0, fixed = true) "Yaw of the assembly, from its nominal direction";
  Types.AngularVelocity rate(start = 0, fixed = true) "Rate of the yaw";
  Types.AngularAcceleration acceleration "Acceleration of the yaw";
  Types.Ratio H[3,3] "From axes of the housing to those of the spacecraft";
  SixDof.TestMass testMass(m_tm = m_tm, I_tm = I_tm, R = rho, omega2 = omega2, omega2_rot = omega2_rot)
    "The test mass, in axes of the housing";
protected
  final parameter Types.Ratio c = cos(direction) "Cosine of the nominal direction";
  final parameter Types.Ratio s = sin(direction) "Sine of the nominal direction";
  final parameter Types.AngularFrequency w = 2*Constants.pi*f_mosa "Angular frequency of the mechanism";
equation
  acceleration = w^2*(command - yaw) - 2*damping_mosa*w*rate;
  der(yaw) = rate;
  der(rate) = acceleration;
  H = {{c - s*yaw, -s - c*yaw, 0}, {s + c*yaw, c - s*yaw, 0}, {0, 0, 1}};
  testMass.a_O = transpose(H)*(a_O + cross(dOmega, p) + cross(Omega, cross(Omega, p)));
  testMass.Omega = transpose(H)*Omega + {0, 0, rate};
  testMass.dOmega = transpose(H)*dOmega + {0, 0, acceleration} - cross({0, 0, rate}, transpose(H)*Omega);
  testMass.g = g - omega2_xy*{testMass.s[2], testMass.s[1], 0};
  testMass.f = F_applied/m_tm;
  testMass.gamma = gamma;
  testMass.nu = N_applied/I_tm;
  r = H*(rho + testMass.s);
  F = H*testMass.F;
  N = H*testMass.N + {0, 0, I_mosa*acceleration};
  annotation (Documentation(info = "<html>
<pre>
  yaw''    = w^2*(command - yaw) - 2*damping_mosa*w*yaw'                         w = 2*pi*f_mosa
  H        = rotation about z by direction + yaw, to first order in yaw
  Omega_j  = H'*Omega + yaw'*z
  dOmega_j = H'*dOmega + yaw''*z - yaw'*z x (H'*Omega)
  a_j      = H'*(a_O + dOmega x p + Omega x (Omega x p))                         acceleration of the pivot
  N        = H*N_j + I_mosa*yaw''*z
</pre>
<p>The test mass is LISAPathfinder.SixDof.TestMass at rho, in a frame that moves with a_j, Omega_j and dOmega_j. Its
stiffness has a cross term in addition, F_x/m_tm = ... - omega2_xy*y, F_y/m_tm = ... - omega2_xy*x. A positive yaw
turns x_j towards +y; the second order of the yaw, 1e-12 of a length at 1 urad, is left out. The mechanism pushes the
assembly by I_mosa*yaw'' against the spacecraft.</p>
<p>Defaults: test mass as flown on LISA Pathfinder; stiffness, inertia and mechanism of the assembly are a choice.</p>
</html>"));
end Assembly;
