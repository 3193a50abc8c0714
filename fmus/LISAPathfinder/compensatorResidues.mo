within LISAPathfinder;
function compensatorResidues "Partial fractions of the compensator K(s), scaled to its unity gain"
  input Types.Frequency f_u "Frequency where abs(K(s)/s^2) = 1";
  input Types.Frequency f_z "Lead zero";
  input Types.Frequency f_i "Zero of the integrator";
  input Types.Frequency f_p "First pole";
  input Types.Frequency f_r "Second pole";
  output Real r[3] "Residues at the poles 0, f_p, f_r";
protected
  constant Real pi = 3.14159265358979323846 "Circle constant";
  Real u = 2*pi*f_u "Angular frequencies of f_u, f_z, f_i, f_p, f_r";
  Real z = 2*pi*f_z;
  Real i = 2*pi*f_i;
  Real p = 2*pi*f_p;
  Real r_ = 2*pi*f_r;
  Real k "Gain of K(s) = k (s + z)(s + i) / (s (1 + s/p)(1 + s/r_))";
algorithm
  k := u^3*sqrt((1 + (u/p)^2)*(1 + (u/r_)^2)/((u^2 + z^2)*(u^2 + i^2)));
  r[1] := k*z*i;
  r[2] := k*r_*(z - p)*(i - p)/(p - r_);
  r[3] := k*p*(z - r_)*(i - r_)/(r_ - p);
end compensatorResidues;
