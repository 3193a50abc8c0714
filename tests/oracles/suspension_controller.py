"""A suspension controller in Python, for `pythonfmu3` to make an FMU of: an exporter that is not ours.

Its names are its own. K(s) is discretised with the bilinear rule as a
chain of second-order sections; ours is a sum of first-order terms.
"""

import math

import numpy as np
from pythonfmu3 import (
    Float64,
    Fmi3Causality,
    Fmi3Slave,
    Fmi3Status,
    Fmi3StepResult,
    Fmi3Variability,
    Unit,
)
from scipy.signal import bilinear_zpk, zpk2sos


class Suspension(Fmi3Slave):
    """Acceleration u = bias - K(distance - wanted)."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.register_units([Unit("m", m=1), Unit("m/s2", m=1, s=-2), Unit("Hz", s=-1)])
        self.time = self.u = self.bias = self.distance = self.wanted = 0.0
        self.unity_gain = 1e-3
        kinds, of = Fmi3Causality, Fmi3Variability
        for name, causality, variability, unit in (
            ("time", kinds.independent, of.continuous, None),
            ("bias", kinds.parameter, of.tunable, "m/s2"),
            ("unity_gain", kinds.parameter, of.tunable, "Hz"),
            ("u", kinds.output, of.continuous, "m/s2"),
            ("distance", kinds.input, of.continuous, "m"),
            ("wanted", kinds.input, of.continuous, "m"),
        ):
            self.register_variable(Float64(name, causality=causality, variability=variability, unit=unit))

    def exit_initialization_mode(self):
        """Work out the filter from the parameters."""
        zeros = [-2 * math.pi * f for f in (0.3e-3, 0.06e-3)]
        poles = [0.0, *(-2 * math.pi * f for f in (6e-3, 30e-3))]
        s = 2j * math.pi * self.unity_gain
        shape = np.prod([s - z for z in zeros]) / np.prod([s - p for p in poles])
        sections = zpk2sos(*bilinear_zpk(zeros, poles, abs(s) ** 2 / abs(shape), fs=10.0))
        self._sections, self._memory = sections.tolist(), [[0.0, 0.0] for _ in sections]

    def do_step(self, current_time, step_size):
        """Filter one sample."""
        x = self.distance - self.wanted
        for (b0, b1, b2, _, a1, a2), memory in zip(self._sections, self._memory, strict=True):
            out = b0 * x + memory[0]
            memory[:] = b1 * x - a1 * out + memory[1], b2 * x - a2 * out
            x = out
        self.u = self.bias - x
        return Fmi3StepResult(status=Fmi3Status.ok)
