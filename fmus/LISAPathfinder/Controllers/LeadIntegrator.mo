within LISAPathfinder.Controllers;
block LeadIntegrator "K(s) = k (s + z)(s + i) / (s (1 + s/p)(1 + s/r)), sampled by the bilinear rule"
  extends Icons.Controller;
  replaceable type Error = Types.Position constrainedby Real "Controlled quantity";
  replaceable type Filtered = Types.FilteredPosition constrainedby Real "Filtered error";
  replaceable type Effort = Types.Acceleration constrainedby Real "Control effort";
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Frequency f_u = 0.08 "Frequency where abs(K(s)/s^2) = 1";
  parameter Types.Frequency f_z = 0.03 "Lead zero";
  parameter Types.Frequency f_i = 0.006 "Zero of the integrator";
  parameter Types.Frequency f_p = 0.8 "First pole";
  parameter Types.Frequency f_r = 2 "Second pole";
  final parameter Types.AngularFrequency p[3] = 2*Constants.pi*{0, f_p, f_r} "Poles";
  final parameter Real r[3](each unit = "s-3") = Functions.leadIntegratorResidues(f_u, f_z, f_i, f_p, f_r) "Residues";
  final parameter Real discretePole[3](each unit = "1") = (fill(1, 3) - h/2*p) ./ (fill(1, 3) + h/2*p)
    "Poles in the z plane";
  final parameter Types.Time inputTime[3] = fill(h/2, 3) ./ (fill(1, 3) + h/2*p) "Weights of the sampled errors";
  input Error e "Error, an apparent displacement or angle";
  output Effort a "Demanded acceleration";
  discrete Error e_k(start = 0, fixed = true) "Last sampled error";
  discrete Filtered s[3](each start = 0, each fixed = true) "Filtered errors, one for each pole";
equation
  when sample(0, h) then
    e_k = e;
    s = discretePole .* pre(s) + inputTime*(e_k + pre(e_k));
  end when;
  a = r*s;
  annotation (Documentation(info = "<html>
<p>K(s) = k (s + z)(s + i)/(s (1 + s/p)(1 + s/r)), discretised by Tustin's rule with sampling time h; z, i, p, r are
the angular frequencies of f_z, f_i, f_p, f_r, and k makes abs(K(s)/s^2) = 1 at f_u, the unity gain of a loop around a
free mass. K is realised by its partial fractions, a state for each pole.</p>
<p>Sign: the demanded acceleration a counteracts a positive error e where the loop subtracts it.</p>
<p>Defaults: drag-free control along x; unity gain and phase lead were measured in flight, zeros and poles are a
choice that reproduces them.</p>
</html>"));
end LeadIntegrator;
