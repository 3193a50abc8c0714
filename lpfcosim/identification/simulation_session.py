"""The FMUs of one run, loaded once and stepped again and again with other parameters and inputs."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.cosim import FmuInstance, Interface, SimulationProgress, Value, co_simulation
from lpfcosim.errors import InputError, RunError
from lpfcosim.models import model_of
from lpfcosim.network import Component
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]
Values = Mapping[str, Mapping[str, float]]  # of the FMUs' own parameters, by model

BLOCK = 20_000  # samples whose feeds are in memory at a time
STRETCH = 2_000  # samples that are simulated again to see whether an FMU starts anew
EXCITATION = 1e-12  # SI, of every feed meanwhile: small against all limits of the loop

_messages = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Reference:
    """What instances that nobody had used made of some parameters and feeds of `STRETCH` samples.

    `recorded` has the shape (channels, STRETCH); `signals` is all that was on the bus after the last sample.
    """

    changed: Values
    feeds: Mapping[str, Array]
    recorded: Array
    signals: Array


class SimulationSession:
    """A loop, or a part of it, that is simulated as often as it takes.

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
    progress : SimulationProgress, optional
        Kept up to date, if this is the only loop that is stepped at a time.
    """

    def __init__(
        self,
        stack: contextlib.ExitStack,
        run: Run,
        interfaces: Sequence[Interface],
        feeds: Sequence[str],
        record: Mapping[str, str],
        progress: SimulationProgress | None,
    ) -> None:
        self._run, self._interfaces, self._progress = run, interfaces, progress or SimulationProgress()
        self._feeds, self._record = feeds, record
        self._given = model_of(run).parameters(run)
        self._instances = co_simulation.load(stack, interfaces, self._progress)
        self._progress.set_idle()
        self._used = False
        self._third_party_instances = [
            instance for instance, i in zip(self._instances, interfaces, strict=True) if i.replacement
        ]
        self._renewed: Sequence[FmuInstance] = ()  # those whose reset does not do
        self._reference: _Reference | None = None
        components = [i.component for i in interfaces]
        self._network = co_simulation.CoSimulation(
            run.name, run.h, components, self._instances, feeds, record.values(), progress=self._progress
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
        try:
            with co_simulation.translate_fmi_errors(self._run.name, self._instances):
                return self._simulated(n, inputs, changed)
        finally:
            self._progress.set_idle()

    def _simulated(self, n: int, inputs: Mapping[str, Array], changed: Values) -> dict[str, Array]:
        if self._third_party_instances and not self._renewed:
            self._check_reset(changed, inputs)
        self._start(changed, self._renewed)
        recorded = np.empty((len(self._record), n))
        for start in range(0, n, BLOCK):
            stop = min(start + BLOCK, n)
            recorded[:, start:stop] = self._advance(start, stop, inputs)
        return dict(zip(self._record, recorded, strict=True))

    def _advance(self, start: int, stop: int, inputs: Mapping[str, Array]) -> Array:
        """Step from one sample to another; return what is recorded, of shape (channels, stop - start)."""
        feeds = np.zeros((len(self._feeds), stop - start))
        for row, name in zip(feeds, self._feeds, strict=True):
            if name in inputs:
                row[:] = inputs[name][start:stop]
        if start == 0:
            self._network.initialize(feeds[:, 0])
        part = np.empty((len(self._record), stop - start))
        self._network.advance(feeds.T, part.T, start)
        co_simulation.check_measurement_range(self._run, list(self._record), part, start)
        return part

    def _parameters(self, changed: Values) -> Iterator[tuple[FmuInstance, Mapping[str, Value]]]:
        for instance, i in zip(self._instances, self._interfaces, strict=True):
            yield instance, {**i.parameters(self._given[i.model]), **changed.get(i.model, {})}

    def _start(self, changed: Values, renewed: Sequence[FmuInstance]) -> None:
        """Take all FMUs to their start, those in `renewed` by new instances if they were used."""
        self._progress.reset()
        for instance, parameters in self._parameters(changed):
            if not self._used:
                instance.initialize(parameters)
            elif instance in renewed:
                instance.renew(parameters)
            else:
                instance.restart(parameters)
        if self._used and renewed:
            self._network.connect()
        self._used = True

    def _check_reset(self, changed: Values, inputs: Mapping[str, Array]) -> None:
        """See whether a reset takes the FMUs of the user to their start, else use new instances from now on.

        The inputs have noise added: in a loop at rest a reset that does nothing would not be seen.

        Raises
        ------
        RunError
            If new instances do not repeat what the first did either.
        """
        if self._reference is None:
            feeds: dict[str, Array] = {}
            for name in self._feeds:
                noise = np.random.default_rng(len(feeds)).uniform(-EXCITATION, EXCITATION, STRETCH)
                x = inputs.get(name, np.zeros(1))[:STRETCH]
                feeds[name] = noise + np.pad(x, (0, STRETCH - x.size), mode="edge")
            self._start(changed, self._third_party_instances)
            recorded = self._advance(0, STRETCH, feeds)
            self._reference = _Reference(changed, feeds, recorded, self._network.signals)
        fault = self._difference(self._reference, ())
        if not fault:
            return
        names = ", ".join(instance.name for instance in self._third_party_instances)
        _messages.info("%s: a reset is not sufficient (%s), new instances are used", names, fault)
        self._renewed = self._third_party_instances
        new_instance_fault = self._difference(self._reference, self._renewed)
        if new_instance_fault:
            files = ", ".join(str(i.named) for i in self._interfaces if i.replacement)
            raise RunError(
                f"run '{self._run.name}': {files}: does not repeat itself: after a reset, {fault}; in a new "
                f"instance, {new_instance_fault}; expected an FMU that repeats its outputs for the same "
                "parameters and inputs, as identification simulates it many times"
            )

    def _difference(self, reference: _Reference, renewed: Sequence[FmuInstance]) -> str:
        """Simulate the reference again; return what differs from the first time, empty if nothing does."""
        try:
            with co_simulation.translate_fmi_errors(self._run.name, self._instances):
                self._start(reference.changed, renewed)
                recorded = self._advance(0, STRETCH, reference.feeds)
        except (RunError, InputError) as error:
            return str(error)
        signals = self._network.signals
        is_equal = np.array_equal(recorded, reference.recorded) and np.array_equal(signals, reference.signals)
        return "" if is_equal else f"its outputs in the first {STRETCH * self._run.h:g} s are not the same"


def load_loop(
    stack: contextlib.ExitStack,
    run: Run,
    interfaces: Sequence[Interface],
    record: Iterable[str],
    progress: SimulationProgress | None = None,
) -> SimulationSession:
    """Load all FMUs of a run, to record some of its channels."""
    sources = model_of(run).record
    return SimulationSession(
        stack, run, interfaces, model_of(run).stimuli(run), {name: sources[name] for name in record}, progress
    )


def load_controller(
    stack: contextlib.ExitStack,
    run: Run,
    interfaces: Sequence[Interface],
    progress: SimulationProgress | None = None,
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
            controller_interfaces = [replace(i, component=place)]
            return SimulationSession(
                stack, run, controller_interfaces, feeds, {output: f"{i.model}.{output}"}, progress
            )
    raise RunError(f"run '{run.name}': no FMU of the loop has the output {output}")
