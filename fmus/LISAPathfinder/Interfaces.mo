within LISAPathfinder;
package Interfaces "Connectors: one signal each, with quantity, unit and nominal value of its type"
  extends Icons.Package;
  connector PositionInput = input Types.Position "Input: a position"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {0,0,127}, fillPattern = FillPattern.Solid)}));
  connector PositionOutput = output Types.Position "Output: a position"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {255,255,255}, fillPattern = FillPattern.Solid)}));
  connector AngleInput = input Types.Angle "Input: an angle"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {0,0,127}, fillPattern = FillPattern.Solid)}));
  connector AngleOutput = output Types.Angle "Output: an angle"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {255,255,255}, fillPattern = FillPattern.Solid)}));
  connector AngularVelocityInput = input Types.AngularVelocity "Input: an angular velocity"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {0,0,127}, fillPattern = FillPattern.Solid)}));
  connector AngularVelocityOutput = output Types.AngularVelocity "Output: an angular velocity"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {255,255,255}, fillPattern = FillPattern.Solid)}));
  connector AccelerationInput = input Types.Acceleration "Input: an acceleration, or a force per unit mass"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {0,0,127}, fillPattern = FillPattern.Solid)}));
  connector AccelerationOutput = output Types.Acceleration "Output: an acceleration, or a force per unit mass"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {255,255,255}, fillPattern = FillPattern.Solid)}));
  connector AngularAccelerationInput = input Types.AngularAcceleration
    "Input: an angular acceleration, or a torque per unit inertia"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {0,0,127}, fillPattern = FillPattern.Solid)}));
  connector AngularAccelerationOutput = output Types.AngularAcceleration
    "Output: an angular acceleration, or a torque per unit inertia"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {255,255,255}, fillPattern = FillPattern.Solid)}));
  connector ForceInput = input Types.Force "Input: an electrostatic force"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {0,0,127}, fillPattern = FillPattern.Solid)}));
  connector ForceOutput = output Types.Force "Output: an electrostatic force"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {255,255,255}, fillPattern = FillPattern.Solid)}));
  connector TorqueInput = input Types.Torque "Input: an electrostatic torque"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {0,0,127}, fillPattern = FillPattern.Solid)}));
  connector TorqueOutput = output Types.Torque "Output: an electrostatic torque"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {255,255,255}, fillPattern = FillPattern.Solid)}));
  connector ThrustInput = input Types.Thrust "Input: a thrust"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {0,0,127}, fillPattern = FillPattern.Solid)}));
  connector ThrustOutput = output Types.Thrust "Output: a thrust"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {255,255,255}, fillPattern = FillPattern.Solid)}));
  connector ThrustTorqueInput = input Types.ThrustTorque "Input: a torque of the thrusters"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {0,0,127}, fillPattern = FillPattern.Solid)}));
  connector ThrustTorqueOutput = output Types.ThrustTorque "Output: a torque of the thrusters"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {255,255,255}, fillPattern = FillPattern.Solid)}));
  connector RatioInput = input Types.Ratio "Input: a ratio"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {0,0,127}, fillPattern = FillPattern.Solid)}));
  connector RatioOutput = output Types.Ratio "Output: a ratio"
    annotation (Icon(graphics = {Polygon(points = {{-100,100},{100,0},{-100,-100}}, lineColor = {0,0,127},
      fillColor = {255,255,255}, fillPattern = FillPattern.Solid)}));
end Interfaces;
