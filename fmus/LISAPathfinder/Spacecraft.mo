within LISAPathfinder;
model Spacecraft "The spacecraft along x: pushed by its thrusters, and back by what it pushes"
  parameter Types.Mass m_sc = 422.7 "Mass of the spacecraft";
  input Types.Thrust F_thrust "Thrust";
  input Types.Thrust F_noise "Force noise of thrusters and environment";
  input Types.Force F_1 "Force of the spacecraft on test mass 1";
  input Types.Force F_2 "Force of the spacecraft on test mass 2";
  output Types.Acceleration a_SC "Acceleration of the spacecraft";
equation
  m_sc*a_SC = F_thrust + F_noise - F_1 - F_2;
end Spacecraft;
