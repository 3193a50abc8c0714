within LISAPathfinder;
package OneAxis "Spacecraft and two test masses along the sensitive x axis"
  extends Icons.Package;
  annotation (Documentation(info = "<html>
<p>x points from test mass 1 to test mass 2; x_j is the position of test mass j in its housing, relative to the
spacecraft.</p>
<pre>
  x_j'' = g_j - omega2_j*x_j + lambda_j*f_x_j(t - tau_j) - a_SC        omega2_j &lt; 0 is destabilising
  o_1   = x_1 + n_1
  o_12  = x_2 - x_1 + delta_ifo*x_1 + n_12
</pre>
<p>Plant, Actuation, Interferometer, DragFreeController and SuspensionController become one FMU each. The commands are
sampled and held; Examples.OneAxisClosedLoop connects all of them.</p>
</html>"));
end OneAxis;
