within LISAPathfinder.Controllers;
block AngularLeadIntegrator "Lead compensator with integrator of an angle"
  extends LeadIntegrator(
    redeclare type Error = Types.Angle,
    redeclare type Filtered = Types.FilteredAngle,
    redeclare type Effort = Types.AngularAcceleration);
  annotation (Documentation(info = "<html>
<p>The law of LeadIntegrator between an angle and an angular acceleration.</p>
</html>"));
end AngularLeadIntegrator;
