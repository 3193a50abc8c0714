within LISAPathfinder;
model RigidSpacecraft "The spacecraft in six degrees of freedom: thrusters push it, and what it pushes pushes back"
  parameter Types.Mass m_sc = 422.7 "Mass of the spacecraft";
  parameter Types.Inertia I_sc[3] = {202.5, 209.7, 191.7} "Inertia about x, y, z";
  parameter Types.Length R_1[3] = zeros(3) "Place of the housing of test mass 1";
  parameter Types.Length R_2[3] = zeros(3) "Place of the housing of test mass 2";
  parameter Types.AngularVelocity Omega_start[3] = zeros(3) "Rate at the start";
  input Types.Thrust F_sc[3] "Force of thrusters and noise";
  input Types.ThrustTorque N_sc[3] "Torque of thrusters and noise";
  input Types.Position s_1[3] "Position of test mass 1 in its housing";
  input Types.Position s_2[3] "Position of test mass 2 in its housing";
  input Types.Force F_1[3] "Force of the spacecraft on test mass 1";
  input Types.Force F_2[3] "Force of the spacecraft on test mass 2";
  input Types.Torque N_1[3] "Torque of the spacecraft on test mass 1";
  input Types.Torque N_2[3] "Torque of the spacecraft on test mass 2";
  output Types.Acceleration a_O[3] "Acceleration of the centre of the spacecraft";
  output Types.Angle attitude[3](each start = 0, each fixed = true) "Small angles with respect to J2000";
  output Types.AngularVelocity Omega[3](start = Omega_start, each fixed = true) "Rate with respect to J2000";
  output Types.AngularAcceleration dOmega[3] "Angular acceleration";
equation
  m_sc*a_O = F_sc - F_1 - F_2;
  I_sc .* dOmega = N_sc - N_1 - N_2 - cross(R_1 + s_1, F_1) - cross(R_2 + s_2, F_2) - cross(Omega, I_sc .* Omega);
  der(Omega) = dOmega;
  der(attitude) = Omega;
end RigidSpacecraft;
