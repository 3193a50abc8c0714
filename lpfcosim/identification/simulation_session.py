"""The FMUs of one run, loaded once and stepped again and again with other parameters and inputs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.cosim import Interface, SimulationProgress, co_simulation
from lpfcosim.errors import RunError
from lpfcosim.models import check_measurement_range, model_of
from lpfcosim.network import Component
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]
Values = Mapping[str, Mapping[str, float]]  # of the FMUs' own parameters, by model

BLOCK = 20_000  # samples whose feeds are in memory at a time


class SimulationSession:
    """A loop, or a part of it, that is simulated as often as it takes.

    Our FMUs are reset before each simulation. Third-party ones are loaded anew, since a reset need not take
    them back to their start.

    Parameters
    ----------
    stack : ExitStack
        Frees the FMUs.
    run : Run
        Gives the parameters that no trial changes.
    interfaces : sequence of Interface
        The FMUs, in the order of their steps; see `cosim.interfaces`.
    feeds : sequence of str
        Signals from outside.
    record : mapping of str to str
        What is recorded, and its source.
    progress : SimulationProgress
        Kept up to date.
    """

    def __init__(
        self,
        stack: contextlib.ExitStack,
        run: Run,
        interfaces: Sequence[Interface],
        feeds: Sequence[str],
        record: Mapping[str, str],
        progress: SimulationProgress,
    ) -> None:
        self._run, self._interfaces = run, interfaces
        self._feeds, self._record = feeds, record
        self._parameters = model_of(run).parameters(run)
        self._progress = progress
        progress.reset()
        self._instances = co_simulation.load(stack, interfaces, progress)
        progress.set_idle()
        self._is_new = True
        self._co_simulation = co_simulation.CoSimulation(
            run.name,
            run.h,
            [i.component for i in interfaces],
            self._instances,
            feeds,
            record.values(),
            self._progress,
        )

    def simulate(self, n: int, inputs: Mapping[str, Array], changed: Values) -> dict[str, Array]:
        """Step through `n` samples.

        Parameters
        ----------
        n : int
            Number of samples.
        inputs : mapping of str to ndarray, each of shape (n,)
            Of the feeds; those that are not in it are zero.
        changed : mapping of str to mapping of str to float
            By model, the FMU's own parameters that differ from those of the run.

        Returns
        -------
        dict of str to ndarray, each of shape (n,)
            What is recorded.

        Raises
        ------
        RunError
            If an FMU refuses, or the loop is not stable.
        """
        recorded = np.empty((len(self._record), n))
        with co_simulation.translate_fmi_errors(self._run.name, self._instances):
            self._start(changed)
            for start in range(0, n, BLOCK):
                stop = min(start + BLOCK, n)
                feeds = np.zeros((len(self._feeds), stop - start))
                for row, name in zip(feeds, self._feeds, strict=True):
                    if name in inputs:
                        row[:] = inputs[name][start:stop]
                if start == 0:
                    self._co_simulation.initialize(feeds[:, 0])
                part = np.empty((len(self._record), stop - start))
                self._co_simulation.advance(feeds.T, part.T, start)
                check_measurement_range(self._run, list(self._record), part, start)
                recorded[:, start:stop] = part
        self._progress.set_idle()
        return dict(zip(self._record, recorded, strict=True))

    def _start(self, changed: Values) -> None:
        """Take all FMUs to their start, with these parameters."""
        self._progress.reset()
        for instance, i in zip(self._instances, self._interfaces, strict=True):
            parameters = {**i.parameters(self._parameters[i.model]), **changed.get(i.model, {})}
            if self._is_new:
                instance.initialize(parameters)
            elif i.replacement:
                instance.renew(parameters)
            else:
                instance.restart(parameters)
        if not self._is_new and any(i.replacement for i in self._interfaces):
            self._co_simulation.connect()
        self._is_new = False


def load_loop(
    stack: contextlib.ExitStack,
    run: Run,
    interfaces: Sequence[Interface],
    record: Iterable[str],
    progress: SimulationProgress,
) -> SimulationSession:
    """Load all FMUs of a run, to record some of its channels."""
    sources = model_of(run).record
    feeds = model_of(run).stimuli(run)
    return SimulationSession(
        stack, run, interfaces, feeds, {name: sources[name] for name in record}, progress
    )


def load_controller(
    stack: contextlib.ExitStack, run: Run, interfaces: Sequence[Interface]
) -> SimulationSession:
    """Load the controller of test mass 2 along x by itself, fed with its own inputs.

    Raises
    ------
    RunError
        If the loop has no such.
    """
    output = "f_control_2"
    for i in interfaces:
        if output in i.component.outputs:
            feeds = tuple(i.component.inputs)
            place = Component(i.model, {name: name for name in feeds}, i.component.outputs)
            controller = [replace(i, component=place)]
            record, progress = {output: f"{i.model}.{output}"}, SimulationProgress()
            return SimulationSession(stack, run, controller, feeds, record, progress)
    raise RunError(f"run '{run.name}': no FMU of the loop has the output {output}")
