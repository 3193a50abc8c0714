within LISAPathfinder;
function limited "What an actuator of limited authority makes of a command"
  input Real command "Command";
  input Real authority "Largest magnitude";
  output Real value "Command within the authority";
algorithm
  value := max(-authority, min(authority, command));
end limited;
