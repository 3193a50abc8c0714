"""The closed loop of a run from the equations of its models: state space, loop gain, simulation.

The models are joined by name and evaluated in the order of the co-simulation, each seeing what those before
it computed at the same sample, and the plant's motion as its last step left it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lpfcosim.linear.sampled_model import OperatingPoint, SampledModel
from lpfcosim.linear.state_space import StateSpace
from lpfcosim.models import check_measurement_range, model_of, stimuli
from lpfcosim.network import Component, endpoint
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]
Values = Sequence[float]
_Function = Callable[[Values], Values]

BLOCK = 6000  # samples between two checks of the measurement range


class ClosedLoop:
    """Models of a run, joined by name.

    Parameters
    ----------
    run : Run
        Its parameters and which models it has.

    Raises
    ------
    InputError
        If the models form an algebraic loop, or cannot be translated.
    """

    def __init__(self, run: Run) -> None:
        self.run, self._spacecraft = run, model_of(run)
        self.components: tuple[Component, ...] = self._spacecraft.components(run)
        parameters = self._spacecraft.parameters(run)
        self._models = [SampledModel(c.model, parameters[c.model], run.h) for c in self.components]
        sources = [s for c in self.components for s in c.inputs.values()]
        #: Signals from outside.
        self.inputs = tuple(dict.fromkeys(s for s in sources if not endpoint(s)[0]))
        #: Names of the control loops.
        self.loops = tuple(_loop_name(model.name, law) for model in self._models for law in model.controllers)

    @property
    def commands(self) -> dict[str, float]:
        """Largest magnitude of each command that an authority limits, SI; zero where there is none."""
        return {name: limit for model in self._models for name, limit in model.limits.items()}

    @property
    def limits(self) -> dict[str, float]:
        """Largest magnitude of each command of limited authority, SI; none is clipped without."""
        return {name: limit for name, limit in self.commands.items() if limit > 0}

    def equilibrium(self) -> dict[str, float]:
        """Return the outputs of the models at the equilibrium, by name, SI."""
        points = zip(self._models, self._operating_points({}), strict=True)
        values = ((model.outputs, model.outputs_at(point)) for model, point in points)
        return {name: float(x) for names, xs in values for name, x in zip(names, xs, strict=True)}

    # Linearisation -------------------------------------------------------------------------------------

    def linearize(self, commands: Mapping[str, float] | None = None) -> StateSpace:
        """Linearise the loop about its equilibrium, with no command at its limit.

        Parameters
        ----------
        commands : mapping of str to float, optional
            Sampled variables that count as having other values, such as the rms of a command that a noisy
            gain multiplies.

        Returns
        -------
        StateSpace
            From `inputs` to the outputs of the models.
        """
        loop = self._joined(commands or {})
        names = self._observed()
        outputs = tuple(endpoint(name)[1] for name in names)
        units = {name: self._spacecraft.units[name] for name in (*self.inputs, *outputs)}
        return replace(loop.select(self.inputs, names), outputs=outputs, units=units)

    def loop_gain(self) -> StateSpace:
        """Return the loop gain L, all loops cut at the errors of their controllers: error = -L error.

        With disturbances d added to the errors, x+ = A x + B d and error = C x; cut, d is what the
        controllers take less the error that comes back, so that x+ = (A - B C) x + B error.
        """
        laws = [f"{model.name}.{law}" for model in self._models for law in model.controllers]
        closed = self._joined({}).select([f"{law}.disturbance" for law in laws], [f"{law}.e" for law in laws])
        A, B, C = closed.A, closed.B, closed.C
        return StateSpace(A - B @ C, B, -C, np.zeros_like(closed.D), self.loops, self.loops, closed.dt)

    def _observed(self) -> list[str]:
        """Return the outputs that are fed on or recorded, and the motion, as ``Model.output``."""
        return [
            f"{component.model}.{name}"
            for component, model in zip(self.components, self._models, strict=True)
            for name in (model.state_outputs if component.moves else component.outputs)
        ]

    def _joined(self, commands: Mapping[str, float]) -> StateSpace:
        """Return the loop with disturbances of the errors as inputs, and all outputs as ``Model.output``."""
        points = self._operating_points(commands)
        systems = [
            model.linearize(point, moves=component.moves)
            for model, component, point in zip(self._models, self.components, points, strict=True)
        ]
        n = sum(len(system.A) for system in systems)
        laws = [f"{m.name}.{law}.disturbance" for m in self._models for law in m.controllers]
        unit = np.eye(n + len(self.inputs) + len(laws))
        rows = dict(zip((*self.inputs, *laws), unit[n:], strict=True))
        states, begin = {}, 0
        for component, system in zip(self.components, systems, strict=True):
            states[component.model] = unit[begin : begin + len(system.A)]
            begin += len(system.A)
            if component.moves:
                values = system.C @ states[component.model]
                rows |= _named(component.model, system.outputs, values)
        updates = []
        for component, system in zip(self.components, systems, strict=True):
            x, model = states[component.model], component.model
            sources = (component.inputs.get(name, f"{model}.{name}") for name in system.inputs)
            u = np.array([rows.get(source, np.zeros(len(unit))) for source in sources]).reshape(-1, len(unit))
            updates.append(system.A @ x + system.B @ u)
            if not component.moves:
                rows |= _named(model, system.outputs, system.C @ x + system.D @ u)
        A, C = np.concatenate(updates), np.array(list(rows.values()))
        inputs = (*self.inputs, *laws)
        return StateSpace(A[:, :n], A[:, n:], C[:, :n], C[:, n:], inputs, tuple(rows), self.run.h)

    def _operating_points(self, commands: Mapping[str, float]) -> list[OperatingPoint]:
        """Return the models at the equilibrium."""
        values = self._initial_outputs()
        points: list[OperatingPoint] = []
        for component, model in zip(self.components, self._models, strict=True):
            u = [values.get(component.inputs.get(name, ""), 0.0) for name in model.inputs]
            points.append(model.operating_point(u, commands))
            values |= _named(model.name, model.outputs, model.outputs_at(points[-1]))
        return points

    def _initial_outputs(self, signals: Mapping[str, float] | None = None) -> dict[str, float]:
        """Return signals from outside and, passed on once in the order of the steps, outputs at the start."""
        values = dict(signals or {})
        for component, model in zip(self.components, self._models, strict=True):
            u = [values.get(component.inputs.get(name, ""), 0.0) for name in model.inputs]
            values |= _named(model.name, model.outputs, model.initial_outputs(u))
        return values

    # Simulation ----------------------------------------------------------------------------------------

    def simulate(self, signals: Mapping[str, Array] | None = None) -> dict[str, Array]:
        """Simulate the run from its equilibrium, commands limited by their authority.

        Parameters
        ----------
        signals : mapping of str to ndarray, shape (n_samples,)
            Signals from outside by name, SI; what is missing is zero. By default those of the run.

        Returns
        -------
        dict
            Recorded channels and outputs of the models by name, each of shape (n_samples,), SI.

        Raises
        ------
        RunError
            If a read-out leaves its range.
        """
        run = self.run
        by_name = stimuli.stimuli(run) if signals is None else signals
        zero = np.zeros(run.n_samples)
        driven = [by_name.get(name, zero) for name in self.inputs]
        advance, names = self._network([float(signal[0]) for signal in driven])
        recorded = np.empty((run.n_samples, len(names)))
        for begin in range(0, run.n_samples, BLOCK):
            block = recorded[begin : begin + BLOCK]
            block[:] = np.nan
            with np.errstate(over="ignore", invalid="ignore"), suppress(OverflowError):  # refused below
                for i, values in enumerate(
                    zip(*(s[begin : begin + BLOCK].tolist() for s in driven), strict=True)
                ):
                    block[i] = advance(values)
            check_measurement_range(run, names, block.T, begin)
        channels = dict(zip(names, recorded.T.copy(), strict=True))
        return channels | {n: by_name.get(n, zero) for n in self._spacecraft.record if n not in channels}

    def _network(self, signals: Sequence[float]) -> tuple[_Function, list[str]]:
        """Return a function from the signals of a sample to the outputs of the models, and their names."""
        values = self._initial_outputs(dict(zip(self.inputs, signals, strict=True)))
        place = {name: i for i, name in enumerate(values)}
        bus = [*values.values(), 0.0]  # the last is that of inputs that nothing feeds
        plants: list[tuple[_Function, _Function, list[int]]] = []
        direct: list[tuple[_Function, _Function, slice]] = []
        for component, model in zip(self.components, self._models, strict=True):
            sources = _getter([place.get(component.inputs.get(name, ""), -1) for name in model.inputs])
            step = model.stepper(sources(bus), moves=component.moves)
            if component.moves:
                into = [place[f"{model.name}.{name}"] for name in model.state_outputs]
                plants.append((step, sources, into))
            else:
                begin = place[f"{model.name}.{model.outputs[0]}"]  # of outputs that lie side by side
                direct.append((step, sources, slice(begin, begin + len(model.outputs))))
        recorded = self._observed()
        rows = _getter([place[name] for name in recorded])
        n = len(self.inputs)

        def advance(signals: Values) -> Values:
            bus[:n] = signals
            for step, sources, outputs in direct:
                bus[outputs] = step(sources(bus))
            row = rows(bus)
            motions = [step(sources(bus)) for step, sources, _ in plants]
            for (_, _, into), values in zip(plants, motions, strict=True):
                for i, value in zip(into, values, strict=True):
                    bus[i] = value
            return row

        return advance, [endpoint(name)[1] for name in recorded]


def _getter(places: Sequence[int]) -> _Function:
    """Return a function that takes the values at some places of a sequence, without a loop in Python."""
    if len(places) > 1:
        return itemgetter(*places)
    return lambda values: [values[i] for i in places]


def _named(model: str, names: Sequence[str], values: Iterable[Any]) -> dict[str, Any]:
    return {f"{model}.{name}": value for name, value in zip(names, values, strict=True)}


def _loop_name(model: str, law: str) -> str:
    """Return the name of a control loop: ``drag_free_x`` of law x of WholeDragFreeControl."""
    words = re.findall("[A-Z][a-z]+", model.removesuffix("Control"))
    return "_".join([*(word.lower() for word in words if word != "Whole"), law])
