"""A PID controller of the distance between the test masses, as an FMU: see first-hour.md.

``pythonfmu3 build -f docs/my_controller.py`` writes MyController.fmu.
"""

from math import exp, pi

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Status, Fmi3StepResult, Fmi3Variability

STEP = 0.1  # s, one sample
CAUSALITIES = {
    "time": Fmi3Causality.independent,
    "distance": Fmi3Causality.input,
    "wanted": Fmi3Causality.input,
    "bandwidth": Fmi3Causality.parameter,
    "hold": Fmi3Causality.parameter,
    "force": Fmi3Causality.output,
}


class MyController(Fmi3Slave):
    """Force per unit mass that brings the distance to the wanted one."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__(**kwargs)
        for name, causality in CAUSALITIES.items():
            setattr(self, name, 0.0)
            tunable = causality == Fmi3Causality.parameter
            variability = Fmi3Variability.tunable if tunable else Fmi3Variability.continuous
            self.register_variable(Float64(name, causality=causality, variability=variability))
        self.bandwidth = 1e-3  # Hz
        self.filtered = self.integral = 0.0

    def do_step(self, current_time: float, step_size: float) -> Fmi3StepResult:  # noqa: ARG002
        """Compute the force of one sample."""
        omega = 2 * pi * self.bandwidth
        error = self.distance - self.wanted
        self.filtered += (1 - exp(-6 * omega * STEP)) * (error - self.filtered)
        slope = 6 * omega * (error - self.filtered)
        self.integral += 0.018 * omega**3 * error * STEP
        self.force = self.hold - omega * slope - 0.3 * omega**2 * self.filtered - self.integral
        return Fmi3StepResult(status=Fmi3Status.ok)
