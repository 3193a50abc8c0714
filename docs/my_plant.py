"""A plant of two test masses, one with a cubic spring, as an FMU: see own-plant.md.

``pythonfmu3 build -f docs/my_plant.py`` writes MyPlant.fmu.
"""

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Status, Fmi3StepResult, Fmi3Variability

STEP = 0.1  # s, one sample
SPACECRAFT_MASS, TEST_MASS = 422.7, 1.928  # kg
THRUST_DELAY = 3  # steps
INPUTS = ["pull_1", "pull_2", "push_1", "push_2", "thrust", "gust"]
OUTPUTS = ["position_1", "position_2"]
PARAMETERS = ["spring_1", "spring_2", "cubic_2", "late_1", "late_2"]


class MyPlant(Fmi3Slave):
    """Positions of two test masses in a spacecraft, under delayed commands."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__(**kwargs)
        causalities = (
            {"time": Fmi3Causality.independent}
            | dict.fromkeys(INPUTS, Fmi3Causality.input)
            | dict.fromkeys(PARAMETERS, Fmi3Causality.parameter)
            | dict.fromkeys(OUTPUTS, Fmi3Causality.output)
        )
        for name, causality in causalities.items():
            setattr(self, name, 0.0)
            tunable = causality == Fmi3Causality.parameter
            variability = Fmi3Variability.tunable if tunable else Fmi3Variability.continuous
            self.register_variable(Float64(name, causality=causality, variability=variability))
        self.state = [0.0, 0.0, 0.0, 0.0]  # positions [m] and velocities [m/s]
        self.commands = None  # (pull_1, pull_2, thrust) of this step and of earlier ones

    def do_step(self, current_time: float, step_size: float) -> Fmi3StepResult:  # noqa: ARG002
        """Advance by one sample."""
        command = (self.pull_1, self.pull_2, self.thrust)
        self.commands = [command, *(self.commands or [command] * 9)][:9]
        pulls = []  # time within the step at which a newer command starts to act, older and newer command
        for j, delay in enumerate((self.late_1, self.late_2)):
            steps, switch = divmod(delay, STEP)
            n = int(steps)
            pulls.append((switch, self.commands[n + 1][j], self.commands[n][j]))
        thrust = self.commands[THRUST_DELAY][2]
        start = 0.0
        for end in (*sorted(switch for switch, _, _ in pulls), STEP):
            forces = [older if start < switch else newer for switch, older, newer in pulls]
            self.advance(end - start, forces, thrust)
            start = end
        self.position_1, self.position_2 = self.state[:2]
        return Fmi3StepResult(status=Fmi3Status.ok)

    def derivative(self, state: list[float], forces: list[float], thrust: float) -> list[float]:
        """Return velocities and accelerations with respect to the spacecraft."""
        x_1, x_2, *velocities = state
        a_1 = self.push_1 + forces[0] - self.spring_1 * x_1
        a_2 = self.push_2 + forces[1] - self.spring_2 * x_2 - self.cubic_2 * x_2**3
        spacecraft = (thrust + self.gust - TEST_MASS * (a_1 + a_2)) / SPACECRAFT_MASS
        return [*velocities, a_1 - spacecraft, a_2 - spacecraft]

    def advance(self, h: float, forces: list[float], thrust: float) -> None:
        """Integrate by the midpoint rule; the springs hardly change within a step."""
        if h > 0:
            slope = self.derivative(self.state, forces, thrust)
            middle = [x + h / 2 * v for x, v in zip(self.state, slope, strict=True)]
            slope = self.derivative(middle, forces, thrust)
            self.state = [x + h * v for x, v in zip(self.state, slope, strict=True)]
