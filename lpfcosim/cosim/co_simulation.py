"""The co-simulation algorithm: steps the FMUs of one run through its samples, in blocks."""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import numpy.typing as npt
from fmpy.fmi1 import FMICallException

from lpfcosim.cosim.engine import CompiledLoop
from lpfcosim.cosim.fmu_instance import EARLY, ENDS, NOT_FINITE, FmuInstance, FmuLibraryCache
from lpfcosim.cosim.interface import Interface
from lpfcosim.errors import RunError
from lpfcosim.models import check_measurement_range, model_of, stimuli
from lpfcosim.network import Component
from lpfcosim.spacecraft import Run

Array = npt.NDArray[np.float64]

BLOCK = 40_000  # samples that are in memory at a time
LOADING, _IDLE = -1, -2
_STATUS_DESCRIPTIONS = {
    2: "reports 'discard'",
    3: "reports 'error'",
    4: "reports 'fatal'",
    5: "reports 'pending'",
    ENDS: "requests the end of the simulation",
    EARLY: "returns before the end of its step",
    NOT_FINITE: "returns a value that is not finite",
}


class SimulationProgress(ctypes.Structure):
    """How far a run is, up to date during a call; visible to every process that shares its memory.

    Attributes
    ----------
    sample : int
        Number of the sample; `LOADING` before the first.
    component : int
        Place, in `SpacecraftModel.components`, of the FMU whose code runs; -1: none.
    status : int
        Of the call that failed; 0: none failed.
    simulations : int
        Number of simulations that are done, of a task that has many.
    """

    _fields_ = (
        ("sample", ctypes.c_int64),
        ("component", ctypes.c_int32),
        ("status", ctypes.c_int32),
        ("simulations", ctypes.c_int64),
    )

    def reset(self) -> None:
        """Set the state before anything is loaded."""
        self.sample, self.component, self.status = LOADING, -1, 0

    def set_idle(self) -> None:
        """Set the state in which no code of an FMU runs."""
        self.sample, self.component = _IDLE, -1

    @property
    def is_loading(self) -> bool:
        """Whether the FMUs are being loaded."""
        return self.sample == LOADING


def blocks(
    run: Run,
    interfaces: Sequence[Interface],
    progress: SimulationProgress | None = None,
    libraries: FmuLibraryCache | None = None,
) -> Iterator[dict[str, Array]]:
    """Co-simulate one run, a block of at most `BLOCK` samples at a time.

    Parameters
    ----------
    run : Run
        What to simulate.
    interfaces : sequence of Interface
        The FMU of each component, in the order of the steps; see `read_interfaces`.
    progress : SimulationProgress, optional
        Kept up to date.
    libraries : FmuLibraryCache, optional
        Libraries of our own FMUs that are loaded already.

    Yields
    ------
    dict of str to array
        The channels of `SpacecraftModel.record`, SI.

    Raises
    ------
    InputError
        If an FMU cannot be loaded.
    RunError
        If an FMU reports an error or a read-out leaves its range.
    """
    progress = progress or SimulationProgress()
    progress.reset()
    with contextlib.ExitStack() as stack:
        fmus = start(stack, run, interfaces, progress, libraries)
        with translate_fmi_errors(run.name, fmus):
            yield from RunCoSimulation(run, [i.component for i in interfaces], fmus, progress).blocks()


@contextlib.contextmanager
def translate_fmi_errors(run: str, fmus: Iterable[FmuInstance]) -> Iterator[None]:
    """Raise a `RunError` with the last messages of the FMUs where one refuses a call."""
    try:
        yield
    except FMICallException as error:
        messages = "".join(f"; {fmu.name}: {fmu.last_error}" for fmu in fmus if fmu.last_error)
        raise RunError(f"run '{run}': an FMU refused a call: {error}{messages}") from None


def load(
    stack: contextlib.ExitStack,
    interfaces: Iterable[Interface],
    progress: SimulationProgress | None = None,
    libraries: FmuLibraryCache | None = None,
) -> list[FmuInstance]:
    """Load the FMUs of a run and make an instance of each, not initialised yet; ``stack`` frees them."""
    progress = progress or SimulationProgress()
    fmus = []
    for progress.component, interface in enumerate(interfaces):
        fmus.append(FmuInstance(stack, interface, libraries=libraries))
    return fmus


def start(
    stack: contextlib.ExitStack,
    run: Run,
    interfaces: Sequence[Interface],
    progress: SimulationProgress | None = None,
    libraries: FmuLibraryCache | None = None,
) -> list[FmuInstance]:
    """Load the FMUs of a run and give them their parameters; ``stack`` frees them."""
    progress = progress or SimulationProgress()
    values = model_of(run).parameters(run)
    fmus = load(stack, interfaces, progress, libraries)
    for progress.component, (fmu, i) in enumerate(zip(fmus, interfaces, strict=True)):
        fmu.initialize(i.parameters(values[i.model]))
    return fmus


def _step_error(run: str, fmu: FmuInstance, status: int, time: float) -> RunError:
    description = _STATUS_DESCRIPTIONS.get(status, f"returns status {status}")
    return RunError(f"run '{run}': the {fmu.name} FMU {description} at {time:.1f} s{fmu.error_suffix}")


class CoSimulation:
    """FMU instances and their bus, which holds the stimuli of a sample, then all outputs.

    Parameters
    ----------
    name : str
        Of the run, for messages.
    h : float
        Step [s].
    components : sequence of Component
        Places of the FMUs in the loop, in the order of the steps.
    fmus : list of FmuInstance
        One for each component, with its inputs and outputs in their order.
    stimuli : sequence of str
        Signals from outside.
    record : iterable of str
        Sources, named as in `Component.inputs`, of what is recorded.
    progress : SimulationProgress, optional
        Kept up to date.
    """

    def __init__(
        self,
        name: str,
        h: float,
        components: Sequence[Component],
        fmus: list[FmuInstance],
        stimuli: Sequence[str],
        record: Iterable[str],
        progress: SimulationProgress | None = None,
    ) -> None:
        self._name, self._h, self._fmus, self._progress = name, h, fmus, progress or SimulationProgress()
        self._n_stimuli = len(stimuli)
        place = {name: i for i, name in enumerate(stimuli)}
        self._outputs = []
        for component in components:
            self._outputs.append(len(place))
            for output in component.outputs:
                place[f"{component.model}.{output}"] = len(place)
        self._sources = [[place[source] for source in c.inputs.values()] for c in components]
        self._bus = np.zeros(len(place))
        self._record = np.array([place[source] for source in record], dtype=np.int32)
        self.connect()

    def connect(self) -> None:
        """Build the tables of the compiled loop, anew after an instance was replaced."""
        self._compiled = CompiledLoop(self._fmus, self._sources, self._outputs, self._h)

    @property
    def signals(self) -> Array:
        """What was last on the bus: stimuli, then all outputs; a copy."""
        return self._bus.copy()

    def initialize(self, stimuli: Array) -> None:
        """Pass the outputs on once, in the order of the steps, and begin to step."""
        self._bus[: self._n_stimuli] = stimuli
        connections = zip(self._fmus, self._sources, self._outputs, strict=True)
        for self._progress.component, (fmu, sources, output) in enumerate(connections):
            fmu.inputs[:] = self._bus[sources].tolist()
            fmu.exchange()
            self._bus[output : output + len(fmu.outputs)] = fmu.outputs[:]
        for place, fmu in enumerate(self._fmus):
            self._progress.component = place
            fmu.exit_initialization()

    def advance(self, stimuli: Array, recorded: Array, start: int) -> None:
        """Step through the samples from ``start`` on.

        Parameters
        ----------
        stimuli : array, shape (n, …)
            The signals from outside, sample by sample.
        recorded : array, shape (n, …)
            Filled with what is recorded.
        start : int
            Number of the first sample.
        """
        self._compiled(self._bus, stimuli, self._record, recorded, start, self._progress)
        if self._progress.status:
            fmu = self._fmus[self._progress.component]
            raise _step_error(self._name, fmu, self._progress.status, self._progress.sample * self._h)


class RunCoSimulation(CoSimulation):
    """The co-simulation of a run: driven by its injections and noise, recorded as its channels.

    Parameters
    ----------
    run : Run
        What is simulated.
    components, fmus, progress
        As of `CoSimulation`.
    """

    def __init__(
        self,
        run: Run,
        components: Sequence[Component],
        fmus: list[FmuInstance],
        progress: SimulationProgress | None = None,
    ) -> None:
        self._run = run
        self._noise = stimuli.noise_source(run)
        self._stimuli, self._channels = model_of(run).stimuli(run), model_of(run).record
        record = self._channels.values()
        super().__init__(run.name, run.h, components, fmus, self._stimuli, record, progress)

    def blocks(self) -> Iterator[dict[str, Array]]:
        """Simulate the whole run."""
        buffer = np.empty((len(self._stimuli), BLOCK))  # each signal by itself, as it is drawn
        for start in range(0, self._run.n_samples, BLOCK):
            stop = min(start + BLOCK, self._run.n_samples)
            drawn = {**stimuli.injections(self._run, start, stop), **self._noise.take(stop - start)}
            signals = np.stack([drawn[name] for name in self._stimuli], out=buffer[:, : stop - start])
            if start == 0:
                self.initialize(signals[:, 0])
            recorded = np.empty((len(self._channels), stop - start))
            self.advance(signals.T, recorded.T, start)
            check_measurement_range(self._run, list(self._channels), recorded, start)
            yield dict(zip(self._channels, recorded, strict=True))
