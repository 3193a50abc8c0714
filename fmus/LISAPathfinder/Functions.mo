within LISAPathfinder;
package Functions "Functions of the actuation and of the controllers"
  extends Icons.Package;
  function limit "Command within the authority of an actuator"
    extends Icons.Function;
    input Real u "Command";
    input Real u_max "Authority, the largest magnitude, in the unit of u";
    output Real y "u, or the limit that it exceeds";
  algorithm
    y := max(-u_max, min(u_max, u));
  end limit;
  function leadIntegratorResidues "Partial fractions of a lead compensator with integrator, scaled to its unity gain"
    extends Icons.Function;
    input Types.Frequency f_u "Frequency where abs(K(s)/s^2) = 1";
    input Types.Frequency f_z "Lead zero";
    input Types.Frequency f_i "Zero of the integrator";
    input Types.Frequency f_p "First pole";
    input Types.Frequency f_r "Second pole";
    output Real r[3] "Residues at the poles 0, f_p, f_r";
  protected
    Real u = 2*Constants.pi*f_u "Angular frequency of f_u";
    Real z = 2*Constants.pi*f_z "Angular frequency of f_z";
    Real i = 2*Constants.pi*f_i "Angular frequency of f_i";
    Real p = 2*Constants.pi*f_p "Angular frequency of f_p";
    Real rho = 2*Constants.pi*f_r "Angular frequency of f_r";
    Real k "Gain of K(s) = k (s + z)(s + i) / (s (1 + s/p)(1 + s/rho))";
  algorithm
    k := u^3*sqrt((1 + (u/p)^2)*(1 + (u/rho)^2)/((u^2 + z^2)*(u^2 + i^2)));
    r[1] := k*z*i;
    r[2] := k*rho*(z - p)*(i - p)/(p - rho);
    r[3] := k*p*(z - rho)*(i - rho)/(rho - p);
  end leadIntegratorResidues;
end Functions;
