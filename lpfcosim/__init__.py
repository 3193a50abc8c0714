"""Co-simulation of LISA Pathfinder through FMUs compiled from Modelica."""
