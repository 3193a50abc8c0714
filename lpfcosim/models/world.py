"""What a world is: all that depends on which degrees of freedom of the spacecraft a run has."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lpfcosim.network import Component, in_order
from lpfcosim.signals import Source
from lpfcosim.spacecraft import Run

if TYPE_CHECKING:
    from lpfcosim.models.loop import Loop, System

Array = NDArray[np.float64]
Gain = Callable[[ArrayLike], NDArray[np.complex128]]


@dataclass(frozen=True)
class World:
    """One answer to "which degrees of freedom?", as tables and functions of a run; SI.

    Attributes
    ----------
    name : str
        In words that follow "runs".
    equipment : type
        Of `Run.spacecraft`, by which a run chooses its world.
    components : tuple of Component
        Its FMUs, in any order, with all inputs and with the truths that hang on them.
    record : mapping of str to str
        Telemetry channel to its source, named as in `Component.inputs`.
    units : mapping of str to str
        Unit by the name of a variable or parameter, which means the same in every component.
    parameters : callable
        Values of every component by name.
    sources : callable
        Streams of noise.
    turns : callable
        Set points that grow steadily, by name, and their rates [rad/s].
    limits : callable
        Largest command that authority allows, by telemetry channel.
    simulate : callable
        The reference plant: channels and truth without FMUs, by name, each of shape (n_samples,).
    loop : callable
        One step of plant and controllers.
    system : callable
        The closed loop, linear about its equilibrium.
    loops : tuple of str
        Names of the control loops.
    open_loop : callable
        Loop gain as a function of frequency [Hz], shape (n, loops, loops), all loops cut at their errors.
    attributes : callable
        What a telemetry file says beyond the x axis.
    truth : callable
        True values beyond the x axis, under their names in /truth.
    wired : callable
        Inputs that only some runs have, by component, and their sources; to be added to its inputs.
    signals : str
        The model that holds everything from outside where its parameters put it, for other tools; outputs are
        called like the signals, parameters like them with ``_held``.
    sample_cost, experiment_cost : float
        What `lpfcosim run` takes on a processor of 2024 [s]: a sample of 10 Hz with noise and file, the fit
        and the figures of an experiment with injections.
    """

    name: str
    equipment: type
    components: tuple[Component, ...]
    record: Mapping[str, str]
    units: Mapping[str, str]
    parameters: Callable[[Run], dict[str, dict[str, float]]]
    sources: Callable[[Run], tuple[Source, ...]]
    turns: Callable[[Run], Mapping[str, float]]
    limits: Callable[[Run], dict[str, float]]
    simulate: Callable[[Run], dict[str, Array]]
    loop: Callable[[Run], Loop]
    system: Callable[[Run], System]
    loops: tuple[str, ...]
    open_loop: Callable[[Run], Gain]
    attributes: Callable[[Run], dict[str, float]]
    truth: Callable[[Run], dict[str, float]]
    wired: Callable[[Run], Mapping[str, Mapping[str, str]]]
    signals: str
    sample_cost: float
    experiment_cost: float

    def components_of(self, run: Run) -> tuple[Component, ...]:
        """Components of one run, with the inputs that it wires, in any order."""
        wired = self.wired(run)
        return tuple(replace(c, inputs={**c.inputs, **wired.get(c.model, {})}) for c in self.components)

    def steps(self, run: Run) -> tuple[Component, ...]:
        """Components of one run in the order of their steps, without the inputs it does without."""
        unused = {r.model: r.unused for r in run.replacements}
        return in_order(
            replace(c, inputs={v: s for v, s in c.inputs.items() if v not in unused.get(c.model, ())})
            for c in self.components_of(run)
        )

    def untold(self, run: Run, ignored: Mapping[str, Iterable[str]]) -> set[str]:
        """Names under /truth that are left open by what components, by name, do not take."""
        names = {
            truth
            for c in self.components
            for name in ignored.get(c.model, ())
            for truth in c.truths.get(name, ())
        }
        return names | ({f"delta_ifo_{k}" for k in run.truth.delta_ifo} if "delta_ifo" in names else set())


WORLDS: dict[type, World] = {}


def world_of(run: Run) -> World:
    """Return the world of a run: that of what it has beside the x axis."""
    return WORLDS[type(run.spacecraft)]


def register(*worlds: World) -> None:
    """Add worlds to those that runs can choose."""
    WORLDS.update({world.equipment: world for world in worlds})
