within LISAPathfinder;
model Compensator "K(s) = k (s + z)(s + i) / (s (1 + s/p)(1 + s/r)), sampled by the bilinear rule"
  replaceable type Error = Types.Position "What is controlled";
  replaceable type Filtered = Types.FilteredPosition "An error, filtered";
  replaceable type Effort = Types.Acceleration "What controls it";
  constant Real pi(unit = "1") = 3.14159265358979323846 "Circle constant";
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Frequency f_u = 0.08 "Frequency where abs(K(s)/s^2) = 1";
  parameter Types.Frequency f_z = 0.03 "Lead zero";
  parameter Types.Frequency f_i = 0.006 "Zero of the integrator";
  parameter Types.Frequency f_p = 0.8 "First pole";
  parameter Types.Frequency f_r = 2 "Second pole";
  final parameter Types.AngularFrequency p[3] = 2*pi*{0, f_p, f_r} "Poles";
  final parameter Real r[3](each unit = "s-3") = compensatorResidues(f_u, f_z, f_i, f_p, f_r) "Residues";
  final parameter Real decay[3](each unit = "1") = (fill(1, 3) - h/2*p) ./ (fill(1, 3) + h/2*p)
    "What is left of a filtered error after a sample";
  final parameter Types.Time entry[3] = fill(h/2, 3) ./ (fill(1, 3) + h/2*p) "Weight of a new error";
  input Error e "Error, an apparent displacement or angle";
  output Effort a "Acceleration asked for";
  discrete Error e_k(start = 0, fixed = true) "Last sampled error";
  discrete Filtered s[3](each start = 0, each fixed = true) "Filtered errors, one for each pole";
equation
  when sample(0, h) then
    e_k = e;
    s = decay .* pre(s) + entry*(e_k + pre(e_k));
  end when;
  a = r*s;
end Compensator;
