"""The co-simulation master: steps the FMUs of one run through its samples, in blocks.

Two loops do the same: a compiled one on the functions of the FMUs that FMPy loaded, and a plain one that goes
through FMPy at every call. They give the same bits; the plain one is some hundred times slower.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
from fmpy.fmi1 import FMICallException

from lpfcosim.cosim import compiled
from lpfcosim.cosim.fmu_instance import EARLY, ENDS, NOT_FINITE, FmuInstance
from lpfcosim.cosim.fmu_library import FmuLibraryCache
from lpfcosim.cosim.interface import Interface
from lpfcosim.cosim.stepping import CompiledLoop
from lpfcosim.errors import RunError
from lpfcosim.models import drive, world_of
from lpfcosim.network import Component
from lpfcosim.signals import autoregress
from lpfcosim.spacecraft import READ_OUT_RANGE, Run

Array = npt.NDArray[np.float64]
Engine = Literal["compiled", "fmpy"]

BLOCK = 10_000  # samples that are in memory at a time
LOADING, _RESTING = -1, -2
_LARGEST = float(np.finfo(float).max)
_SAID = {
    2: "reports 'discard'",
    3: "reports 'error'",
    4: "reports 'fatal'",
    5: "reports 'pending'",
    ENDS: "asks to end the simulation",
    EARLY: "returns before the end of its step",
    NOT_FINITE: "puts out a value that is not finite",
}


class SimulationProgress(ctypes.Structure):
    """How far a run is, up to date during a call; visible to every process that shares its memory.

    Attributes
    ----------
    sample : int
        Number of the sample; `LOADING` before the first.
    component : int
        Place, in `World.steps`, of the FMU whose code runs; -1: none.
    status : int
        How it refused a call.
    """

    _fields_ = (("sample", ctypes.c_int64), ("component", ctypes.c_int32), ("status", ctypes.c_int32))

    def reset(self) -> None:
        """Nothing has been done yet."""
        self.sample, self.component, self.status = LOADING, -1, 0

    def set_idle(self) -> None:
        """No FMU is at work from now on."""
        self.sample, self.component = _RESTING, -1

    @property
    def is_idle(self) -> bool:
        """Whether no FMU is at work, and nobody need expect a step."""
        return self.sample == _RESTING


def blocks(
    run: Run,
    found: Sequence[Interface],
    engine: Engine = "compiled",
    where: SimulationProgress | None = None,
    shelf: FmuLibraryCache | None = None,
) -> Iterator[dict[str, Array]]:
    """Co-simulate one run, a block of at most `BLOCK` samples at a time.

    Parameters
    ----------
    run : Run
        What to simulate.
    found : sequence of Interface
        The FMU of each component, in the order of the steps; see `compatibility.interfaces`.
    engine : {"compiled", "fmpy"}
        Which loop steps the FMUs.
    where : SimulationProgress, optional
        Kept up to date.
    shelf : FmuLibraryCache, optional
        SimulationProgress the libraries of our own FMUs come from and go to.

    Yields
    ------
    dict of str to array
        The channels of `World.record`, SI.

    Raises
    ------
    InputError
        If an FMU cannot be loaded.
    RunError
        If an FMU reports an error or a read-out leaves its range.
    """
    try:
        yield from _blocks(run, found, engine, where, shelf)
    except _SilentError as error:
        # Once more, with what it logs: it may say why.
        for _ in _blocks(run, found, engine, where, shelf, logging=True):
            pass
        raise RunError(str(error)) from None


class _SilentError(RunError):
    """An FMU refused a step without a word."""


def _blocks(
    run: Run,
    found: Sequence[Interface],
    engine: Engine,
    where: SimulationProgress | None,
    shelf: FmuLibraryCache | None,
    *,
    logging: bool = False,
) -> Iterator[dict[str, Array]]:
    where = where or SimulationProgress()
    where.reset()
    with contextlib.ExitStack() as stack:
        slaves = start(stack, run, found, where, shelf, logging=logging)
        with translate_fmi_errors(run.name, slaves):
            yield from RunCoSimulation(run, [i.component for i in found], slaves, engine, where).blocks()


@contextlib.contextmanager
def translate_fmi_errors(run: str, slaves: Iterable[FmuInstance]) -> Iterator[None]:
    """Say in one sentence that an FMU refused a call, and what it said."""
    try:
        yield
    except FMICallException as error:
        said = "".join(f"; {s.name}: {s.said}" for s in slaves if s.said)
        raise RunError(f"run '{run}': an FMU refused a call: {error}{said}") from None


def load(
    stack: contextlib.ExitStack,
    found: Iterable[Interface],
    where: SimulationProgress | None = None,
    shelf: FmuLibraryCache | None = None,
    *,
    logging: bool = False,
) -> list[FmuInstance]:
    """Load the FMUs of a run and make an instance of each, not initialised yet; ``stack`` frees them."""
    where = where or SimulationProgress()
    slaves = []
    for where.component, i in enumerate(found):
        theirs = i.replacement is not None
        slaves.append(
            FmuInstance(stack, i, guarded=theirs, logging=logging and theirs, shelf=None if theirs else shelf)
        )
    return slaves


def start(
    stack: contextlib.ExitStack,
    run: Run,
    found: Sequence[Interface],
    where: SimulationProgress | None = None,
    shelf: FmuLibraryCache | None = None,
    *,
    logging: bool = False,
) -> list[FmuInstance]:
    """Load the FMUs of a run and give them their parameters; ``stack`` frees them."""
    where = where or SimulationProgress()
    values = world_of(run).parameters(run)
    slaves = load(stack, found, where, shelf, logging=logging)
    for where.component, (slave, i) in enumerate(zip(slaves, found, strict=True)):
        slave.initialize(i.parameters(values[i.model]))
    return slaves


def _refused(run: str, slave: FmuInstance, status: int, time: float) -> RunError:
    said = _SAID.get(status, f"returns status {status}")
    kind = _SilentError if slave.is_silent and status not in (ENDS, EARLY, NOT_FINITE) else RunError
    return kind(f"run '{run}': the {slave.name} FMU {said} at {time:.1f} s{slave.reason}")


class CoSimulation:
    """Slaves around their bus, which holds the feeds of a sample, then all outputs, then constants.

    Parameters
    ----------
    name : str
        Of the run, for messages.
    h : float
        Step [s].
    components : sequence of Component
        What the slaves are connected to, in the order of the steps.
    slaves : list of FmuInstance
        One for each component, with its inputs and outputs in their order.
    feeds : sequence of str
        Signals from outside.
    record : iterable of str
        Sources, named as in `Component.inputs`, of what is recorded.
    engine : {"compiled", "fmpy"}
        Which loop steps them.
    where : SimulationProgress, optional
        Kept up to date.
    """

    def __init__(
        self,
        name: str,
        h: float,
        components: Sequence[Component],
        slaves: list[FmuInstance],
        feeds: Sequence[str],
        record: Iterable[str],
        engine: Engine = "compiled",
        where: SimulationProgress | None = None,
    ) -> None:
        self._name, self._h, self._slaves, self._where = name, h, slaves, where or SimulationProgress()
        self._n_feeds = len(feeds)
        place = {name: i for i, name in enumerate(feeds)}
        bus = [0.0] * self._n_feeds
        self._outputs = []
        for slave, component in zip(slaves, components, strict=True):
            self._outputs.append(slice(len(bus), len(bus) + len(slave.outputs.values)))
            for output, at in zip(component.outputs, slave.outputs.places, strict=True):
                place[f"{component.model}.{output}"] = len(bus) + at
            bus += [0.0] * len(slave.outputs.values)
        self._sources = []
        for slave, component in zip(slaves, components, strict=True):
            # Elements of an array that nothing feeds keep their start values.
            sources = list(range(len(bus), len(bus) + len(slave.inputs.values)))
            bus += list(slave.inputs.values)
            for source, at in zip(component.inputs.values(), slave.inputs.places, strict=True):
                sources[at] = place[source]
            self._sources.append(sources)
        self._bus = np.array(bus)
        self._record = np.array([place[source] for source in record], dtype=np.int32)
        self._engine = engine
        self.connect()

    def connect(self) -> None:
        """Take up the instances that the slaves have now."""
        tables = self._engine == "compiled"
        self._compiled = CompiledLoop(self._slaves, self._sources, self._outputs) if tables else None

    @property
    def signals(self) -> Array:
        """What was last on the bus: feeds, then all outputs, then constants; a copy."""
        return self._bus.copy()

    def initialize(self, feeds: Array) -> None:
        """Pass the outputs on once, in the order of the steps, and begin to step."""
        self._bus[: self._n_feeds] = feeds
        every = zip(self._slaves, self._sources, self._outputs, strict=True)
        for self._where.component, (slave, sources, outputs) in enumerate(every):
            slave.inputs.values[:] = self._bus[sources].tolist()
            slave.exchange()
            self._bus[outputs] = slave.outputs.values[:]
        for place, slave in enumerate(self._slaves):
            self._where.component = place
            slave.exit_initialization()

    def advance(self, feeds: Array, recorded: Array, start: int) -> None:
        """Step through the samples from ``start`` on.

        Parameters
        ----------
        feeds : array, shape (n, …)
            The signals from outside, sample by sample.
        recorded : array, shape (n, …)
            Filled with what is recorded.
        start : int
            Number of the first sample.
        """
        if self._compiled is None:
            self._plain(feeds, recorded, start)
        else:
            self._compiled(self._bus, feeds, self._record, recorded, start, self._h, self._where)
        if self._where.status:
            slave = self._slaves[self._where.component]
            raise _refused(self._name, slave, self._where.status, self._where.sample * self._h)

    def _plain(self, feeds: Array, recorded: Array, start: int) -> None:
        bus, h, record, where = self._bus.tolist(), self._h, self._record.tolist(), self._where
        steps = list(zip(self._slaves, self._sources, self._outputs, strict=True))
        for i, feed in enumerate(feeds.tolist()):
            where.sample = start + i
            bus[: self._n_feeds] = feed
            for where.component, (slave, sources, outputs) in enumerate(steps):
                slave.inputs.values[:] = [bus[k] for k in sources]
                time = (start + i) * h
                status = slave.step(time, (start + i + 1) * h - time if slave.guarded else h)
                if status > 1:  # beyond a warning
                    where.status = status
                    return
                bus[outputs] = slave.outputs.values[:]
            recorded[i] = [bus[k] for k in record]
        self._bus[:] = bus
        where.sample, where.component = start + len(feeds), -1


class RunCoSimulation(CoSimulation):
    """The slaves of a run as it is simulated: fed with its injections and noise, recorded as its channels.

    Parameters
    ----------
    run : Run
        What is simulated.
    components, slaves, engine, where
        As of `CoSimulation`.
    """

    def __init__(
        self,
        run: Run,
        components: Sequence[Component],
        slaves: list[FmuInstance],
        engine: Engine,
        where: SimulationProgress | None = None,
    ) -> None:
        self._run = run
        self._noise = drive.stream(run, compiled.autoregress if engine == "compiled" else autoregress)
        self._feeds, self._channels = drive.names(run), world_of(run).record
        record = self._channels.values()
        super().__init__(run.name, run.h, components, slaves, self._feeds, record, engine, where)

    def blocks(self) -> Iterator[dict[str, Array]]:
        """Simulate the whole run."""
        room = np.empty((len(self._feeds), BLOCK))  # each signal by itself, as it is drawn
        for start in range(0, self._run.n_samples, BLOCK):
            stop = min(start + BLOCK, self._run.n_samples)
            drawn = {**drive.injections(self._run, start, stop), **self._noise.take(stop - start)}
            feeds = np.stack([drawn[name] for name in self._feeds], out=room[:, : stop - start])
            if start == 0:
                self.initialize(feeds[:, 0])
            recorded = np.empty((len(self._channels), stop - start))
            self.advance(feeds.T, recorded.T, start)
            check_measurement_range(self._run, list(self._channels), recorded, start)
            yield dict(zip(self._channels, recorded, strict=True))


def check_measurement_range(run: Run, channels: Sequence[str], recorded: Array, start: int) -> None:
    """Refuse channels, shape (channels, n), from sample ``start`` on that are not finite, or out of range.

    Raises
    ------
    RunError
        Gives channel and time.
    """
    limits = [READ_OUT_RANGE if c in ("o_1", "o_12") else _LARGEST for c in channels]
    least, most = recorded.min(axis=1), recorded.max(axis=1)  # both NaN where one sample is
    if not np.all((-least <= limits) & (most <= limits)):
        lost = ~(np.abs(recorded) <= np.array(limits)[:, None])
        i = int(lost.any(axis=0).argmax())
        j = int(lost[:, i].argmax())
        finite = np.isfinite(recorded[j, i])
        how = f"leaves its range of {READ_OUT_RANGE:g} m" if finite else "is not finite"
        time = (start + i) * run.h
        raise RunError(f"run '{run.name}' diverges: {channels[j]} {how} at {time:.1f} s")
