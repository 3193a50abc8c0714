within ;
package LISA "Drag-free dynamics and control of one spacecraft of LISA"
  extends LISAPathfinder.Icons.Package;
  import LISAPathfinder.Constants;
  import LISAPathfinder.Controllers;
  import LISAPathfinder.Functions;
  import LISAPathfinder.Icons;
  import LISAPathfinder.Interfaces;
  import LISAPathfinder.OneAxis;
  import LISAPathfinder.SixDof;
  import LISAPathfinder.Types;
  annotation (
    version = "1",
    uses(LISAPathfinder(version = "1")),
    Documentation(info = "<html>
<p>Two movable optical assemblies, 60 degrees apart, with a test mass in each. Bodies, thrusters, control laws and
capacitive read-outs are those of LISAPathfinder. Plant, Metrology, DragFreeControl, SuspensionControl, PointingControl
and Actuation become one FMU each, as does LISAPathfinder.SixDof.InertialSensor; Examples.ClosedLoop connects them.</p>
<p><b>Frames.</b> B is fixed to the spacecraft: origin in its centre of mass, x bisects the assemblies, z is normal to
the plane of the constellation. H_j is fixed to assembly and housing j: x_j points along the telescope, outwards. H_1 is
turned from B about z by half_opening + mosa_1, H_2 by -half_opening + mosa_2. Angles theta, eta, phi are about x, y, z.
The signs are those of lisainstrument: phi_j = Phi + mosa_j, eta_j = cos(a_j)*Eta - sin(a_j)*Theta with a_1 =
half_opening = -a_2.</p>
<p><b>What is left out.</b> The frame that the constellation turns with, once a year, counts as inertial. The assemblies
do not pitch, and each is balanced about its pivot.</p>
<p>Real numbers of the spacecraft are not public: masses, inertia, geometry and control are choices, and the
documentation of each model says so.</p>
</html>"));
end LISA;
