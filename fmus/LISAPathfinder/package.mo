package LISAPathfinder "Drag-free dynamics and control of LISA Pathfinder"
  annotation (
    version = "1",
    Documentation(info = "<html>
<p>The model of record of lpfcosim. Every class that stands alone becomes one FMU; the remaining ones are
parts.</p>
<p><b>Along the sensitive x axis</b>: Plant, Actuation, OpticalMetrology, DragFreeControl,
SuspensionControl. x points from test mass 1 to test mass 2; x_j is the position of test mass j in its
housing, that is relative to the spacecraft.</p>
<pre>
  x_j'' = g_j - omega2_j*x_j + lambda_j*f_x_j(t - tau_j) - a_SC        omega2_j &lt; 0 is destabilising
  o_1   = x_1 + n_1
  o_12  = x_2 - x_1 + delta_ifo*x_1 + n_12
</pre>
<p><b>The whole spacecraft</b>, six degrees of freedom for it and each test mass: WholePlant, WholeActuation,
WholeMetrology, InertialSensor, StarTracker, WholeDragFreeControl, WholeSuspensionControl, AttitudeControl.
theta, eta, phi are about x, y, z. Omega is the rate of the spacecraft with respect to J2000 and a_O the
acceleration of its centre, in body axes; test mass j is at r_j = R_j + s_j, where
R_2 = -R_1 = (d, delta_y, delta_z)/2.</p>
<pre>
  s_j''       = F_j/m_tm - a_O - dOmega x r_j - Omega x (Omega x r_j) - 2 Omega x s_j'
  angle_j''   = N_j/I_tm - dOmega - Omega x angle_j'
  m_sc*a_O    = F_sc - F_1 - F_2
  I_sc*dOmega = N_sc - N_1 - N_2 - r_1 x F_1 - r_2 x F_2 - Omega x (I_sc*Omega)
</pre>
<p>SI units throughout. Motion is of the order of a nanometre, hence the nominal values.</p>
</html>"));
end LISAPathfinder;
