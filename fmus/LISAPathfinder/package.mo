package LISAPathfinder "Drag-free dynamics and control of LISA Pathfinder along the sensitive x axis"
  annotation (
    version = "1",
    Documentation(info = "<html>
<p>The model of record of lpfcosim. Every class that stands alone (Plant, Actuation,
OpticalMetrology, DragFreeControl, SuspensionControl) becomes one FMU; the remaining ones are parts.</p>
<p><b>Sign convention</b>, stated here once. x points from test mass 1 to test mass 2; x_j is the
position of test mass j in its housing, that is relative to the spacecraft.</p>
<pre>
  x_j'' = g_j - omega2_j*x_j + lambda_j*f_x_j(t - tau_j) - a_SC        omega2_j &lt; 0 is destabilising
  o_1   = x_1 + n_1
  o_12  = x_2 - x_1 + delta_ifo*x_1 + n_12
</pre>
<p>SI units throughout. Motion is of the order of a nanometre, hence the nominal values.</p>
</html>"));
end LISAPathfinder;
