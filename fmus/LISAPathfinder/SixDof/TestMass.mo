within LISAPathfinder.SixDof;
model TestMass "Free-floating test mass, six degrees of freedom, seen from the rotating spacecraft"
  extends Icons.Body;
  parameter Types.Mass m_tm = 1.928 "Mass of the test mass";
  parameter Types.Inertia I_tm = 6.80e-4 "Inertia of the test mass, a cube, about any axis";
  parameter Types.Length R[3] = zeros(3) "Location of its housing, from the centre of the spacecraft";
  parameter Types.Stiffness omega2[3] = {-4e-7, -8e-7, -8e-7} "Stiffness along x, y, z";
  parameter Types.Stiffness omega2_rot[3] = fill(-1.5e-6, 3) "Stiffness about x, y, z";
  Interfaces.AccelerationInput g[3] "Stray force per unit mass";
  Interfaces.AccelerationInput f[3] "Applied electrostatic force per unit mass";
  Interfaces.AngularAccelerationInput gamma[3] "Stray torque per unit inertia";
  Interfaces.AngularAccelerationInput nu[3] "Applied electrostatic torque per unit inertia";
  Interfaces.AccelerationInput a_O[3] "Acceleration of the spacecraft";
  Interfaces.AngularVelocityInput Omega[3] "Rate of the spacecraft";
  Interfaces.AngularAccelerationInput dOmega[3] "Angular acceleration of the spacecraft";
  Interfaces.PositionOutput s[3](each start = 0, each fixed = true) "Position in the housing";
  Interfaces.AngleOutput angle[3](each start = 0, each fixed = true) "Small angles against the housing";
  Interfaces.ForceOutput F[3] "Force of the spacecraft on the test mass";
  Interfaces.TorqueOutput N[3] "Torque of the spacecraft on the test mass";
  Types.Velocity v[3](each start = 0, each fixed = true) "Velocity relative to the housing";
  Types.AngularVelocity w[3](each start = 0, each fixed = true) "Rate relative to the housing";
equation
  F = m_tm*(g - omega2 .* s + f);
  N = I_tm*(gamma - omega2_rot .* angle + nu);
  der(s) = v;
  der(v) = F/m_tm - a_O - cross(dOmega, R + s) - cross(Omega, cross(Omega, R + s) + 2*v);
  der(angle) = w;
  der(w) = N/I_tm - dOmega - cross(Omega, w);
  annotation (Documentation(info = "<html>
<pre>
  F = m_tm*(g - omega2*s + f)          s''     = F/m_tm - a_O - dOmega x (R + s) - Omega x (Omega x (R + s) + 2 s')
  N = I_tm*(gamma - omega2_rot*angle + nu)   angle'' = N/I_tm - dOmega - Omega x angle'
</pre>
<p>in body axes of the spacecraft. A negative stiffness is destabilising. Defaults: mass as flown, I_tm = m a^2/6 of a
cube of side 46 mm, stiffness beyond x a choice.</p>
</html>"));
end TestMass;
