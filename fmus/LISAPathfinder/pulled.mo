within LISAPathfinder;
function pulled "What electrodes make of a command whose gain changes, by itself and with the command"
  input Real lambda "Mean gain";
  input Real f "Command";
  input Real bend "Relative growth of the gain with the command";
  input Real gain "Relative change of the gain by itself";
  output Real applied "What the test mass receives";
algorithm
  applied := lambda*f*(1 + bend*abs(f))*(1 + gain);
end pulled;
