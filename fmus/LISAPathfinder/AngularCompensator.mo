within LISAPathfinder;
model AngularCompensator "Compensator of an angle"
  extends Compensator(
    redeclare type Error = Types.Angle,
    redeclare type Filtered = Types.FilteredAngle,
    redeclare type Effort = Types.AngularAcceleration);
end AngularCompensator;
