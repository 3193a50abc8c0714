"""The control laws, as continuous transfer functions; they are sampled by the bilinear rule at 10 Hz."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Controller:
    """K(s) = k (s+wz)(s+wi) / [s (1+s/wp)(1+s/wr)] with |K| = w^2 at the unity gain; frequencies in Hz."""

    unity_gain: float
    zero: float
    integrator_zero: float
    poles: tuple[float, float]

    @property
    def gain(self) -> float:
        """The k [s^-1] that makes |K(i 2 pi fu)| = (2 pi fu)^2 at the unity gain fu."""
        s = 2j * math.pi * self.unity_gain
        wz, wi, wp, wr = (2 * math.pi * f for f in (self.zero, self.integrator_zero, *self.poles))
        shape = (s + wz) * (s + wi) / (s * (1 + s / wp) * (1 + s / wr))
        return abs(s) ** 2 / abs(shape)

    @property
    def rates(self) -> tuple[float, float, float]:
        """The p_i [rad/s] of the parallel form K(s) = sum_i r_i / (s + p_i)."""
        return 0.0, 2 * math.pi * self.poles[0], 2 * math.pi * self.poles[1]

    @property
    def residues(self) -> tuple[float, float, float]:
        """The r_i [s^-3] of the parallel form K(s) = sum_i r_i / (s + p_i)."""
        wz, wi = 2 * math.pi * self.zero, 2 * math.pi * self.integrator_zero
        _, wp, wr = self.rates
        scale = self.gain * wp * wr
        return (
            scale * wz * wi / (wp * wr),
            scale * (wz - wp) * (wi - wp) / (-wp * (wr - wp)),
            scale * (wz - wr) * (wi - wr) / (-wr * (wp - wr)),
        )


DRAG_FREE = Controller(unity_gain=0.08, zero=0.03, integrator_zero=0.006, poles=(0.8, 2.0))
SUSPENSION = Controller(unity_gain=1.0e-3, zero=0.30e-3, integrator_zero=0.06e-3, poles=(6e-3, 30e-3))


@dataclass(frozen=True)
class Lead:
    """L(s) = k (s+wz) / (1+s/wp)^3 with |L| = w^2 at the unity gain; frequencies in Hz."""

    unity_gain: float
    zero: float
    pole: float

    @property
    def gain(self) -> float:
        """The k [s^-1] that makes |L(i 2 pi fu)| = (2 pi fu)^2 at the unity gain fu."""
        u, z = 2 * math.pi * self.unity_gain, 2 * math.pi * self.zero
        slope = math.hypot(1, self.unity_gain / self.pole)
        return u * u * slope * slope * slope / math.hypot(u, z)
