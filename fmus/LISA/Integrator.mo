within LISA;
block Integrator "K(s) = 2*pi*f_u/s of an angle, sampled by the bilinear rule"
  extends Icons.Controller;
  parameter Types.Time h = 0.1 "Sampling time";
  parameter Types.Frequency f_u = 3e-3 "Unity gain";
  Interfaces.AngleInput e "Error";
  Interfaces.AngleOutput a "Demanded angle";
  discrete Types.Angle e_k(start = 0, fixed = true) "Last sampled error";
  discrete Types.FilteredAngle s(start = 0, fixed = true) "Integral of the error";
equation
  when sample(0, h) then
    e_k = e;
    s = pre(s) + h/2*(e_k + pre(e_k));
  end when;
  a = 2*Constants.pi*f_u*s;
  annotation (Documentation(info = "<html>
<p>K(s) = 2*pi*f_u/s, discretised by Tustin's rule with sampling time h: unity gain at f_u of a loop around a mechanism
that follows its command. Default: a choice.</p>
</html>"));
end Integrator;
