"""The control laws, as continuous transfer functions; they are sampled by the bilinear rule at 10 Hz."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Controller:
    """K(s) = k (s+wz)(s+wi) / [s (1+s/wp)(1+s/wr)] with |K| = w^2 at the unity gain; frequencies in Hz."""

    unity_gain: float
    zero: float
    integrator_zero: float
    poles: tuple[float, float]


DRAG_FREE = Controller(unity_gain=0.08, zero=0.03, integrator_zero=0.006, poles=(0.8, 2.0))
SUSPENSION = Controller(unity_gain=1.0e-3, zero=0.30e-3, integrator_zero=0.06e-3, poles=(6e-3, 30e-3))


@dataclass(frozen=True)
class Lead:
    """L(s) = k (s+wz) / (1+s/wp)^3 with |L| = w^2 at the unity gain; frequencies in Hz."""

    unity_gain: float
    zero: float
    pole: float
