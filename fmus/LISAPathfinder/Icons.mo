within LISAPathfinder;
package Icons "Icons of the models"
  partial package Package "A package"
    annotation (Icon(graphics = {
      Rectangle(extent = {{-100,100},{100,-100}}, lineColor = {40,60,90}, fillColor = {245,247,250},
        fillPattern = FillPattern.Solid),
      Text(extent = {{-150,140},{150,105}}, textString = "%name", textColor = {0,0,255})}));
  end Package;
  partial model Body "A rigid body"
    annotation (Icon(graphics = {
      Rectangle(extent = {{-100,100},{100,-100}}, lineColor = {40,60,90}, fillColor = {245,247,250},
        fillPattern = FillPattern.Solid),
      Rectangle(extent = {{-50,50},{50,-50}}, lineColor = {40,60,90}, fillColor = {60,110,180},
        fillPattern = FillPattern.Solid),
      Text(extent = {{-150,140},{150,105}}, textString = "%name", textColor = {0,0,255})}));
  end Body;
  partial model Plant "Spacecraft with two test masses"
    annotation (Icon(graphics = {
      Rectangle(extent = {{-100,100},{100,-100}}, lineColor = {40,60,90}, fillColor = {245,247,250},
        fillPattern = FillPattern.Solid),
      Rectangle(extent = {{-80,25},{-30,-25}}, lineColor = {40,60,90}, fillColor = {60,110,180},
        fillPattern = FillPattern.Solid),
      Rectangle(extent = {{30,25},{80,-25}}, lineColor = {40,60,90}, fillColor = {60,110,180},
        fillPattern = FillPattern.Solid),
      Text(extent = {{-150,140},{150,105}}, textString = "%name", textColor = {0,0,255})}));
  end Plant;
  partial model Sensor "A sensor"
    annotation (Icon(graphics = {
      Rectangle(extent = {{-100,100},{100,-100}}, lineColor = {40,60,90}, fillColor = {245,247,250},
        fillPattern = FillPattern.Solid),
      Line(points = {{-80,0},{80,0}}, color = {200,0,0}, thickness = 1),
      Ellipse(extent = {{-25,25},{25,-25}}, lineColor = {40,60,90}, fillColor = {255,255,255},
        fillPattern = FillPattern.Solid),
      Text(extent = {{-150,140},{150,105}}, textString = "%name", textColor = {0,0,255})}));
  end Sensor;
  partial model Actuator "An actuator"
    annotation (Icon(graphics = {
      Rectangle(extent = {{-100,100},{100,-100}}, lineColor = {40,60,90}, fillColor = {245,247,250},
        fillPattern = FillPattern.Solid),
      Line(points = {{-80,-60},{-40,-60},{40,60},{80,60}}, color = {40,60,90}, thickness = 1),
      Text(extent = {{-150,140},{150,105}}, textString = "%name", textColor = {0,0,255})}));
  end Actuator;
  partial model Controller "A sampled controller"
    annotation (Icon(graphics = {
      Rectangle(extent = {{-100,100},{100,-100}}, lineColor = {40,60,90}, fillColor = {245,247,250},
        fillPattern = FillPattern.Solid),
      Line(points = {{-80,-60},{-40,-60},{-40,-20},{0,-20},{0,20},{40,20},{40,60},{80,60}}, color = {40,60,90},
        thickness = 1),
      Text(extent = {{-150,140},{150,105}}, textString = "%name", textColor = {0,0,255})}));
  end Controller;
  partial model Source "A source of signals"
    annotation (Icon(graphics = {
      Rectangle(extent = {{-100,100},{100,-100}}, lineColor = {40,60,90}, fillColor = {245,247,250},
        fillPattern = FillPattern.Solid),
      Line(points = {{-80,0},{-60,50},{-40,70},{-20,50},{0,0},{20,-50},{40,-70},{60,-50},{80,0}}, color = {40,60,90},
        thickness = 1),
      Text(extent = {{-150,140},{150,105}}, textString = "%name", textColor = {0,0,255})}));
  end Source;
  partial model Example "A model to be simulated"
    annotation (Icon(graphics = {
      Ellipse(extent = {{-100,100},{100,-100}}, lineColor = {40,60,90}, fillColor = {255,255,255},
        fillPattern = FillPattern.Solid),
      Polygon(points = {{-40,60},{70,0},{-40,-60}}, lineColor = {60,110,180}, fillColor = {60,110,180},
        fillPattern = FillPattern.Solid),
      Text(extent = {{-150,140},{150,105}}, textString = "%name", textColor = {0,0,255})}));
  end Example;
  partial function Function "A function"
    annotation (Icon(graphics = {
      Ellipse(extent = {{-100,100},{100,-100}}, lineColor = {40,60,90}, fillColor = {255,255,255},
        fillPattern = FillPattern.Solid),
      Text(extent = {{-60,60},{60,-60}}, textString = "f"),
      Text(extent = {{-150,140},{150,105}}, textString = "%name", textColor = {0,0,255})}));
  end Function;
end Icons;
