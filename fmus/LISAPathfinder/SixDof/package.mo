within LISAPathfinder;
package SixDof "Spacecraft and two test masses, six degrees of freedom each"
  extends Icons.Package;
  annotation (Documentation(info = "<html>
<p>theta, eta, phi are about x, y, z. Omega is the rate of the spacecraft with respect to J2000 and a_O the acceleration
of its centre, in body axes; test mass j is at r_j = R_j + s_j, where R_2 = -R_1 = (d, delta_y, delta_z)/2.</p>
<pre>
  s_j''       = F_j/m_tm - a_O - dOmega x r_j - Omega x (Omega x r_j) - 2 Omega x s_j'
  angle_j''   = N_j/I_tm - dOmega - Omega x angle_j'
  m_sc*a_O    = F_sc - F_1 - F_2
  I_sc*dOmega = N_sc - N_1 - N_2 - r_1 x F_1 - r_2 x F_2 - Omega x (I_sc*Omega)
</pre>
<p>Along x, commands are accelerations (forces per unit mass), as in telemetry and in Phys. Rev. D 97, 122002 (2018);
along y and z they are forces, about all axes torques.</p>
</html>"));
end SixDof;
