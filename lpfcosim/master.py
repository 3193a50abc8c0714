"""The co-simulation master: FMPy loads, initialises and steps the FMUs of one run, sample by sample."""

from __future__ import annotations

import contextlib
import ctypes
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import fmpy
import numpy as np
import numpy.typing as npt
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave

from lpfcosim import network, signals
from lpfcosim.errors import InputError, RunError
from lpfcosim.parameters import READ_OUT_RANGE
from lpfcosim.run import Run

Array = npt.NDArray[np.float64]

BLOCK = 10_000  # samples between two reports of progress


class Slave:
    """One FMU 3.0 instance with its inputs and outputs in fixed buffers.

    Parameters
    ----------
    stack : ExitStack
        Frees the instance, its library and its temporary folder.
    archive : Path
        The ``.fmu``.
    component : Component
        Names the variables that are set and read.
    parameters : mapping of str to float
        Values to set before initialisation.

    Raises
    ------
    InputError
        If the archive cannot be read or lacks one of the variables.
    """

    def __init__(
        self,
        stack: contextlib.ExitStack,
        archive: Path,
        component: network.Component,
        parameters: Mapping[str, float],
    ) -> None:
        self.component = component
        try:
            description = fmpy.read_model_description(str(archive))
            folder = fmpy.extract(str(archive))
        except Exception as error:  # FMPy raises bare exceptions for broken archives
            raise InputError(f"{archive}: not a readable FMU: {error}") from None
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        references = {v.name: v.valueReference for v in description.modelVariables}
        for name in (*component.inputs, *component.outputs, *parameters):
            if name not in references:
                raise InputError(
                    f"{archive}: variable '{name}' is missing; expected of the {component.model}"
                )
        self._fmu = FMU3Slave(
            instanceName=component.model,
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
        )
        stack.callback(self._fmu.freeLibrary)
        self._fmu.instantiate()
        stack.callback(self._fmu.fmi3FreeInstance, self._fmu.component)
        self._inputs = (ctypes.c_uint32 * len(component.inputs))(*(references[n] for n in component.inputs))
        self._outputs = (ctypes.c_uint32 * len(component.outputs))(
            *(references[n] for n in component.outputs)
        )
        self.inputs = (ctypes.c_double * len(component.inputs))()
        self.outputs = (ctypes.c_double * len(component.outputs))()
        self._fmu.enterInitializationMode(startTime=0.0)
        self._fmu.setFloat64([references[n] for n in parameters], list(parameters.values()))

    def exchange(self) -> None:
        """Set the inputs and read the outputs without stepping (initialisation)."""
        self._set_inputs()
        self._get_outputs()

    def exit_initialization(self) -> None:
        """Begin to step."""
        self._fmu.exitInitializationMode()

    def step(self, time: float, h: float) -> None:
        """Set the inputs, step from ``time`` to ``time + h``, read the outputs."""
        self._set_inputs()
        self._fmu.doStep(time, h)
        self._get_outputs()

    def _set_inputs(self) -> None:
        n = len(self.inputs)
        self._fmu.fmi3SetFloat64(self._fmu.component, self._inputs, n, self.inputs, n)

    def _get_outputs(self) -> None:
        n = len(self.outputs)
        self._fmu.fmi3GetFloat64(self._fmu.component, self._outputs, n, self.outputs, n)


def simulate(
    run: Run, fmus: Mapping[str, Path], progress: Callable[[int], None] = lambda _: None
) -> dict[str, Array]:
    """Co-simulate one run.

    Parameters
    ----------
    run : Run
        What to simulate.
    fmus : mapping of str to Path
        The FMU of each component of :data:`lpfcosim.network.COMPONENTS`.
    progress : callable
        Told the number of samples done, every :data:`BLOCK` samples.

    Returns
    -------
    dict of str to array, shape (n_samples,)
        The channels of :data:`lpfcosim.network.RECORD`, SI.

    Raises
    ------
    RunError
        If an FMU reports an error or a read-out leaves its range.
    """
    feeds = {**signals.injections(run), **signals.noise(run)}
    with contextlib.ExitStack() as stack:
        values = network.parameters(run)
        slaves = [Slave(stack, fmus[c.model], c, values[c.model]) for c in network.COMPONENTS]
        try:
            return _Loop(run, slaves, feeds).run(progress)
        except FMICallException as error:
            raise RunError(f"run '{run.name}': an FMU refused a call: {error}") from None


class _Loop:
    """The bus holds the signals of this sample, then the outputs of every slave."""

    def __init__(self, run: Run, slaves: list[Slave], feeds: Mapping[str, Array]) -> None:
        self._run = run
        self._feeds = np.column_stack(list(feeds.values()))
        place = {name: i for i, name in enumerate(feeds)}
        for slave in slaves:
            for name in slave.component.outputs:
                place[f"{slave.component.model}.{name}"] = len(place)
        self._bus = [0.0] * len(place)
        self._steps = []
        for slave in slaves:
            first = place[f"{slave.component.model}.{slave.component.outputs[0]}"]
            sources = [place[source] for source in slave.component.inputs.values()]
            self._steps.append((slave, sources, slice(first, first + len(slave.outputs))))
        self._record = [place[source] for source in network.RECORD.values()]

    def run(self, progress: Callable[[int], None]) -> dict[str, Array]:
        self._initialize()
        n_samples = self._run.n_samples
        recorded = np.empty((n_samples, len(self._record)))
        for start in range(0, n_samples, BLOCK):
            stop = min(start + BLOCK, n_samples)
            recorded[start:stop] = self._block(start, stop)
            self._check_range(recorded[start:stop], start)
            progress(stop)
        return dict(zip(network.RECORD, recorded.T.copy(), strict=True))

    def _initialize(self) -> None:
        bus = self._bus
        bus[: self._feeds.shape[1]] = self._feeds[0].tolist()
        for slave, sources, outputs in self._steps:
            slave.inputs[:] = [bus[i] for i in sources]
            slave.exchange()
            bus[outputs] = slave.outputs[:]
        for slave, _, _ in self._steps:
            slave.exit_initialization()

    def _block(self, start: int, stop: int) -> list[list[float]]:
        bus, steps, record, h = self._bus, self._steps, self._record, self._run.h
        n_feeds = self._feeds.shape[1]
        rows = []
        for n, feed in enumerate(self._feeds[start:stop].tolist(), start=start):
            bus[:n_feeds] = feed
            for slave, sources, outputs in steps:
                slave.inputs[:] = [bus[i] for i in sources]
                slave.step(n * h, h)
                bus[outputs] = slave.outputs[:]
            rows.append([bus[i] for i in record])
        return rows

    def _check_range(self, block: Array, start: int) -> None:
        for j, channel in enumerate(network.RECORD):
            bad = ~np.isfinite(block[:, j])
            if channel in ("o_1", "o_12"):
                bad |= np.abs(block[:, j]) > READ_OUT_RANGE
            if bad.any():
                time = (start + int(np.argmax(bad))) * self._run.h
                raise RunError(
                    f"run '{self._run.name}' diverges: {channel} leaves its range of {READ_OUT_RANGE:g} m "
                    f"at {time:.1f} s"
                    if channel in ("o_1", "o_12")
                    else f"run '{self._run.name}' diverges: {channel} is not finite at {time:.1f} s"
                )
