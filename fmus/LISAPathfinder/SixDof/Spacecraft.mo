within LISAPathfinder.SixDof;
model Spacecraft "The spacecraft in six degrees of freedom: thrusters push it, and what it pushes pushes back"
  extends Icons.Body;
  parameter Types.Mass m_sc = 422.7 "Mass of the spacecraft";
  parameter Types.Inertia I_sc[3] = {202.5, 209.7, 191.7} "Inertia about x, y, z";
  parameter Types.Length R_1[3] = zeros(3) "Location of the housing of test mass 1";
  parameter Types.Length R_2[3] = zeros(3) "Location of the housing of test mass 2";
  parameter Types.AngularVelocity Omega_start[3] = zeros(3) "Rate at the start";
  Interfaces.ThrustInput F_sc[3] "Force of thrusters and noise";
  Interfaces.ThrustTorqueInput N_sc[3] "Torque of thrusters and noise";
  Interfaces.PositionInput s_1[3] "Position of test mass 1 in its housing";
  Interfaces.PositionInput s_2[3] "Position of test mass 2 in its housing";
  Interfaces.ForceInput F_1[3] "Force of the spacecraft on test mass 1";
  Interfaces.ForceInput F_2[3] "Force of the spacecraft on test mass 2";
  Interfaces.TorqueInput N_1[3] "Torque of the spacecraft on test mass 1";
  Interfaces.TorqueInput N_2[3] "Torque of the spacecraft on test mass 2";
  Interfaces.AccelerationOutput a_O[3] "Acceleration of the centre of the spacecraft";
  Interfaces.AngleOutput attitude[3](each start = 0, each fixed = true) "Small angles with respect to J2000";
  Interfaces.AngularVelocityOutput Omega[3](start = Omega_start, each fixed = true) "Rate with respect to J2000";
  Interfaces.AngularAccelerationOutput dOmega[3] "Angular acceleration";
equation
  m_sc*a_O = F_sc - F_1 - F_2;
  I_sc .* dOmega = N_sc - N_1 - N_2 - cross(R_1 + s_1, F_1) - cross(R_2 + s_2, F_2) - cross(Omega, I_sc .* Omega);
  der(Omega) = dOmega;
  der(attitude) = Omega;
  annotation (Documentation(info = "<html>
<pre>
  m_sc*a_O    = F_sc - F_1 - F_2
  I_sc*dOmega = N_sc - N_1 - N_2 - (R_1 + s_1) x F_1 - (R_2 + s_2) x F_2 - Omega x (I_sc*Omega)
</pre>
<p>F_j and N_j act on test mass j, and opposite on the spacecraft. The attitude is the integral of Omega, for small
angles. Defaults: mass and inertia as in the LTPDA parameter files.</p>
</html>"));
end Spacecraft;
