within LISAPathfinder.Controllers;
block LeadTripleLag "L(s) = k (s + z) / (1 + s/p)^3 of an angle, three lags in a row, sampled by the bilinear rule"
  extends Icons.Controller;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Frequency f_u = 0.07e-3 "Frequency where abs(L(s)/s^2) = 1";
  parameter Types.Frequency f_z = 0.021e-3 "Zero";
  parameter Types.Frequency f_p = 0.42e-3 "Pole, threefold";
  final parameter Types.AngularFrequency u = 2*Constants.pi*f_u "Angular frequency of f_u";
  final parameter Types.AngularFrequency z = 2*Constants.pi*f_z "Angular frequency of f_z";
  final parameter Types.AngularFrequency p = 2*Constants.pi*f_p "Angular frequency of f_p";
  final parameter Real k(unit = "s-1") = u^2*sqrt(1 + (u/p)^2)^3/sqrt(u^2 + z^2) "Gain";
  final parameter Types.Ratio discretePole = (1 - h*p/2)/(1 + h*p/2) "Pole in the z plane";
  final parameter Types.Ratio inputGain = (h*p/2)/(1 + h*p/2) "Weight of the sampled values";
  Interfaces.AngleInput e "Error";
  Interfaces.AngularAccelerationOutput a "Demanded angular acceleration";
  discrete Types.Angle e_k(start = 0, fixed = true) "Last sampled error";
  discrete Types.Angle lag_1(start = 0, fixed = true) "The error after one lag";
  discrete Types.Angle lag_2(start = 0, fixed = true) "The error after two lags";
  discrete Types.Angle lag_3(start = 0, fixed = true) "The error after three lags";
equation
  when sample(0, h) then
    e_k = e;
    lag_1 = discretePole*pre(lag_1) + inputGain*(e_k + pre(e_k));
    lag_2 = discretePole*pre(lag_2) + inputGain*(lag_1 + pre(lag_1));
    lag_3 = discretePole*pre(lag_3) + inputGain*(lag_2 + pre(lag_2));
  end when;
  a = k*(p*lag_2 + (z - p)*lag_3);
  annotation (Documentation(info = "<html>
<p>L(s) = k (s + z)/(1 + s/p)^3, discretised by Tustin's rule with sampling time h; k makes abs(L(s)/s^2) = 1 at f_u.
Three lags in a row attenuate the noise of the star tracker.</p>
<p>Defaults: attitude control, a choice with a phase margin of 45 degrees.</p>
</html>"));
end LeadTripleLag;
