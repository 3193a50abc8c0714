package LISAPathfinder "Drag-free dynamics and control of LISA Pathfinder"
  extends Icons.Package;
  annotation (
    version = "1",
    Documentation(info = "<html>
<p>The equations that lpfcosim simulates. OneAxis has the dynamics along the sensitive x axis, SixDof those in six
degrees of freedom of the spacecraft and both test masses. Each of their sensors, controllers, actuators and plants
becomes one FMU; Examples connects them.</p>
<p>SI units throughout. Motion is of the order of a nanometre, hence the nominal values in Types. Commands are sampled
with period h and held. The library needs no other one.</p>
</html>"));
end LISAPathfinder;
