within LISAPathfinder;
package Types "SI quantities, with nominal values of drag-free flight"
  extends Icons.Package;
  type Time = Real(final quantity = "Time", final unit = "s");
  type Frequency = Real(final quantity = "Frequency", final unit = "Hz");
  type AngularFrequency = Real(final quantity = "AngularFrequency", final unit = "rad/s");
  type Position = Real(final quantity = "Length", final unit = "m", nominal = 1e-9);
  type Length = Real(final quantity = "Length", final unit = "m");
  type Velocity = Real(final quantity = "Velocity", final unit = "m/s", nominal = 1e-11);
  type Acceleration = Real(final quantity = "Acceleration", final unit = "m/s2", nominal = 1e-12);
  type Angle = Real(final quantity = "Angle", final unit = "rad", nominal = 1e-8);
  type AngularVelocity = Real(final quantity = "AngularVelocity", final unit = "rad/s", nominal = 1e-8);
  type AngularAcceleration = Real(final quantity = "AngularAcceleration", final unit = "rad/s2", nominal = 1e-10);
  type FilteredPosition = Real(final unit = "m.s", nominal = 1e-9);
  type FilteredAngle = Real(final unit = "rad.s", nominal = 1e-8);
  type Mass = Real(final quantity = "Mass", final unit = "kg", min = 0);
  type Inertia = Real(final quantity = "MomentOfInertia", final unit = "kg.m2", min = 0);
  type Force = Real(final quantity = "Force", final unit = "N", nominal = 1e-12);
  type Thrust = Real(final quantity = "Force", final unit = "N", nominal = 1e-7);
  type Torque = Real(final quantity = "Torque", final unit = "N.m", nominal = 1e-12);
  type ThrustTorque = Real(final quantity = "Torque", final unit = "N.m", nominal = 1e-7);
  type Stiffness = Real(final quantity = "SquaredFrequency", final unit = "s-2", nominal = 1e-6)
    "Force gradient per unit mass; negative is destabilising";
  type StiffnessPerForce = Real(final unit = "kg-1.m-1", nominal = 1e2);
  type StiffnessPerTorque = Real(final unit = "kg-1.m-2", nominal = 1e4);
  type Ratio = Real(final unit = "1");
end Types;
