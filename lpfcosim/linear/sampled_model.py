"""One model of the loop, sampled: its exact step from its translated equations, and its linearisation."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.errors import InputError
from lpfcosim.linear.state_space import StateSpace
from lpfcosim.modelica import numerics, numpy_models

Array = NDArray[np.float64]
Values = Sequence[float]

_ROUNDING = 1e-9  # of a sample, within which a delay counts as whole samples


@dataclass(frozen=True)
class OperatingPoint:
    """States, sampled variables before and after their events, inputs and delayed values of a model."""

    x: Values
    q: Values
    u: Values
    d: Values
    z: Values


class SampledModel:
    """A model with its parameters, stepped from sample to sample.

    In each step the sampled variables change first, in the order of their events, limiters included; then
    the states move, with inputs held and delayed values that switch inside the step: exactly for the affine
    part of the derivatives, with the polynomial remainder at its extrapolated midpoint (see
    `lpfcosim.modelica.sorted_model.Affine`).

    Parameters
    ----------
    name : str
        Of the model in the Modelica package.
    parameters : mapping of str to float
        SI; what is missing has the default of the model.
    dt : float
        Sample time [s].

    Raises
    ------
    InputError
        If the model samples at other times, has a negative delay, or has to be translated and cannot be.
    """

    def __init__(self, name: str, parameters: Mapping[str, float], dt: float) -> None:
        self.name, self.dt = name, dt
        self._parameters = parameters
        self._module = module = numpy_models.bind(name, parameters)
        self.inputs = tuple(module.INPUTS)
        self.outputs = tuple(module.OUTPUTS)
        #: Outputs that follow from states and parameters alone.
        self.state_outputs: tuple[str, ...] = module.STATE_OUTPUTS
        #: Control laws, by the name of their part.
        self.controllers = tuple(module.ERRORS)
        self._check_clocks()
        steps = np.array(module.delay_times(), dtype=float) / dt
        if (steps < 0).any():
            raise InputError(f"{name}: a delay is negative, expected none or a positive one")
        self._whole = np.floor(steps + _ROUNDING).astype(int)
        self._part = np.where(steps - self._whole > _ROUNDING, (steps - self._whole) * dt, 0.0)
        #: Samples that each delayed value is remembered for, and what is remembered: (delay, age).
        self._age = self._whole + (self._part > 0)
        self._memory = [(j, age) for j, ages in enumerate(self._age.tolist()) for age in range(1, ages + 1)]

    def _check_clocks(self) -> None:
        times = self._module.clocks()
        for start, period in zip(times[::2], times[1::2], strict=True):
            if abs(start) > 1e-6 * self.dt or abs(period - self.dt) > 1e-6 * self.dt:
                raise InputError(f"{self.name}: samples every {period:g} s, expected {self.dt:g} s")

    @property
    def limits(self) -> dict[str, float]:
        """Largest magnitude of each output behind a limiter, SI."""
        return dict(zip(self._module.LIMITED, self._module.limits(), strict=True))

    @cached_property
    def _transition(self) -> Array:
        """Matrix from (states, held, delayed before and after their switch, 1, remainder) to the next states.

        The old value of delay j acts up to its switch at ``_part[j]``, the new one after it; with
        G(t) the integral of exp(A s) over 0 < s < t, these make of it G(h) - G(h - part) and G(h - part).
        """
        n, n_held = len(self._module.STATES), len(self._module.HELD)
        A = np.array(self._module.A(), dtype=float).reshape(n, n)
        B = np.array(self._module.B(), dtype=float).reshape(n, -1)
        times = [self.dt, *(self.dt - self._part)]
        unique, places = np.unique(times, return_inverse=True)
        augmented = np.block([[A, np.eye(n)], [np.zeros((n, 2 * n))]])
        exponential = scipy.linalg.expm(unique[:, None, None] * augmented)[places]
        integral = exponential[:, :n, n:]
        B_held = integral[0] @ B[:, [*range(n_held), -1]]
        B_new = np.einsum("jnk,kj->nj", integral[1:], B[:, n_held:-1])
        B_old = integral[0] @ B[:, n_held:-1] - B_new
        remainder = integral[0][:, list(self._module.REMAINDER)]
        return np.hstack([exponential[0, :n, :n], B_held[:, :-1], B_old, B_new, B_held[:, -1:], remainder])

    # Simulation ----------------------------------------------------------------------------------------

    def initial_outputs(self, u: Values) -> Values:
        """Return all outputs at the start, before any event, for inputs ``u``."""
        x, z = self._module.state_starts(), self._module.discrete_starts()
        return tuple(self._module.outputs(x, u, self._module.delay_values(u, z), z))

    def stepper(self, u: Values, *, moves: bool) -> Callable[[Values], Values]:
        """Return a function that steps the model by a sample, from its start with inputs ``u``.

        It takes the inputs of the step and returns the outputs after it; those that follow from states
        alone if the model ``moves``, else all.
        """
        module, undisturbed = self._module, [0.0] * len(self.controllers)
        events, delay_values, outputs = module.events, module.delay_values, module.outputs
        state_outputs, held_inputs = module.state_outputs, module.HELD
        x, z = list(map(float, module.state_starts())), list(map(float, module.discrete_starts()))
        if not (x or len(self._age)):  # what remembers its sampled variables alone takes half the time

            def sample(u: Values) -> Values:
                nonlocal z
                z = events(x, z, u, (), undisturbed)
                return outputs(x, u, (), z)  # type: ignore[no-any-return]

            return sample
        delays = list(enumerate(zip(self._whole.tolist(), self._age.tolist(), strict=True)))
        history = deque([delay_values(u, z)] * (int(self._age.max(initial=0)) + 1))
        transition = self._transition if x else None
        remainder, previous = module.remainder if module.REMAINDER else None, None

        def step(u: Values) -> Values:
            nonlocal x, z, previous
            values = delay_values(u, z)
            d = [history[age - 1][j] if age else values[j] for j, (_, age) in delays]
            z = events(x, z, u, d, undisturbed)
            if delays:
                history.pop()
                history.appendleft(delay_values(u, z))
            if transition is not None:
                groups = {"u": u, "z": z}
                row = [*x, *(groups[group][i] for group, i in held_inputs)]
                row += [history[age][j] for j, (_, age) in delays]
                row += [history[whole][j] for j, (whole, _) in delays]
                row.append(1.0)
                if remainder is not None:
                    present = remainder(x, u, [history[age][j] for j, (_, age) in delays], z)
                    row += [1.5 * a - 0.5 * b for a, b in zip(present, previous or present, strict=True)]
                    previous = present
                x = transition.dot(row).tolist()
            if moves:
                return tuple(state_outputs(x))
            d = [history[max(age - 1, 0)][j] for j, (_, age) in delays]
            return tuple(outputs(x, u, d, z))

        return step

    # Linearisation -------------------------------------------------------------------------------------

    def operating_point(self, u: Values, sampled: Mapping[str, float] | None = None) -> OperatingPoint:
        """Return the model at its start with inputs ``u``, its sampled variables settled.

        Parameters
        ----------
        u : sequence of float
            Inputs.
        sampled : mapping of str to float, optional
            Sampled variables that have other values.
        """
        module, undisturbed = self._module, [0.0] * len(self.controllers)
        x, z = module.state_starts(), module.discrete_starts()
        q = z
        d = module.delay_values(u, z)
        for _ in range(2):
            q, z = z, module.events(x, z, u, d, undisturbed)
            d = module.delay_values(u, z)
        z = [(sampled or {}).get(name, value) for name, value in zip(self._module.DISCRETE, z, strict=True)]
        return OperatingPoint(x, q, u, d, z)

    def outputs_at(self, point: OperatingPoint) -> tuple[float, ...]:
        """Return all outputs at an operating point."""
        return tuple(self._module.outputs(point.x, point.u, point.d, point.z))

    def linearize(self, point: OperatingPoint, *, moves: bool) -> StateSpace:
        """Linearise one step about an operating point, with every limiter the identity.

        Parameters
        ----------
        point : OperatingPoint
            Where the derivatives are taken.
        moves : bool
            The outputs that follow from states are those before the step, as other models see them.

        Returns
        -------
        StateSpace
            Its inputs are those of the model, then disturbances of the errors of its `controllers`; its
            outputs likewise, then the errors before these disturbances.
        """
        functions = numpy_models.bind(self.name, self._parameters, derivatives=True)
        rows, disturbance = self._unit_rows()
        width = disturbance.shape[1]
        states = width - len(self.inputs) - len(disturbance)

        def derived(function: str, rows: Mapping[str, Array], **point: Values) -> Array:
            """Return the rows of the values of a function by the chain rule, from those of its arguments."""
            matrix = numerics.jacobian(getattr(functions, function), *point.values())
            return np.asarray(matrix @ np.concatenate([rows[name] for name in point]))

        x, q, u, d, z = point.x, point.q, point.u, point.d, point.z
        delayed = derived("delay_values", rows | {"z": rows["q"]}, u=u, z=z)
        rows["d"] = self._delayed_rows(delayed, rows, self._age)
        undisturbed = [0.0] * len(disturbance)
        tangents = rows | {"z": np.zeros((len(z), width)), "e": disturbance}
        values = derived("event_values", tangents, x=x, q=q, u=u, d=d, z=z, e=undisturbed)
        # each sampled variable follows from those before it as well
        coupling = numerics.jacobian(lambda z: functions.event_values(x, q, u, d, z, undisturbed), z)
        rows["z"] = scipy.linalg.solve_triangular(np.eye(len(z)) - coupling, values, lower=True)
        errors = rows["z"][list(self._module.ERRORS.values())] - disturbance
        issued = derived("delay_values", rows, u=u, z=z)
        acting = rows | {"d": self._delayed_rows(issued, rows, self._age)}
        remainder = derived("remainder", acting, x=x, u=u, d=d, z=z)
        next_states = self._state_rows(rows, issued, 1.5 * remainder - 0.5 * rows["r"])
        ages = np.array([(j, age - 1) for j, age in self._memory], dtype=int).reshape(-1, 2)
        remembered = [self._delayed_row(issued, rows, j, age) for j, age in ages]
        update = np.array([*next_states, *rows["z"], *remembered, *remainder]).reshape(states, width)
        if not moves:
            rows |= {"x": next_states, "d": self._delayed_rows(issued, rows, self._age - 1)}
        output = np.vstack([derived("outputs", rows, x=x, u=u, d=d, z=z), errors])
        return StateSpace(
            A=update[:, :states],
            B=update[:, states:],
            C=output[:, :states],
            D=output[:, states:],
            inputs=(*self.inputs, *(f"{law}.disturbance" for law in self.controllers)),
            outputs=(*self.outputs, *(f"{law}.e" for law in self.controllers)),
            dt=self.dt,
        )

    def _unit_rows(self) -> tuple[dict[str, Array], Array]:
        """Return unit rows over states, memory, inputs and disturbances, by argument of the equations.

        The memory are sampled variables (``q``), delayed values (``m``) and the last remainder (``r``).
        """
        m = self._module
        sizes = {"x": len(m.STATES), "q": len(m.DISCRETE), "m": len(self._memory), "r": len(m.REMAINDER)}
        sizes["u"] = len(m.INPUTS)
        ends = np.cumsum(list(sizes.values()))
        unit = np.eye(ends[-1] + len(m.ERRORS))
        rows = {name: unit[end - size : end] for (name, size), end in zip(sizes.items(), ends, strict=True)}
        return rows, unit[ends[-1] :]

    def _delayed_row(self, issued: Array, rows: Mapping[str, Array], j: int, age: int) -> Array:
        """Return the row of delayed value j as it was ``age`` samples ago; that of age 0 is just issued."""
        return np.asarray(rows["m"][self._memory.index((j, age))] if age > 0 else issued[j])

    def _delayed_rows(self, issued: Array, rows: Mapping[str, Array], ages: NDArray[np.intp]) -> Array:
        """Return the rows of all delayed values, each as it was so many samples ago."""
        delayed = [self._delayed_row(issued, rows, j, age) for j, age in enumerate(ages.tolist())]
        return np.array(delayed).reshape(-1, rows["u"].shape[1])

    def _state_rows(self, rows: Mapping[str, Array], issued: Array, remainder: Array) -> Array:
        """Return the rows of the states after the step."""
        if not self._module.STATES:
            return rows["x"]
        held_rows = [rows[group][i] for group, i in self._module.HELD]
        old, new = (self._delayed_rows(issued, rows, ages) for ages in (self._age, self._whole))
        constant = np.zeros(rows["u"].shape[1])
        columns = np.array([*rows["x"], *held_rows, *old, *new, constant, *remainder])
        return np.asarray(self._transition @ columns)
