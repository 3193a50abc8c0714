"""One FMU of the loop, FMI 2.0 or 3.0: FMPy loads, checks, initialises and frees it."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fmpy import fmi2
from fmpy.fmi1 import FMICallException, printLogMessage

from fit.errors import quote
from lpfcosim.cosim import loaded
from lpfcosim.cosim.interface import describe, resolve, size
from lpfcosim.errors import InputError, RunError
from lpfcosim.messages import line

_messages = logging.getLogger(__name__)

_MOST = 10_000  # elements of an array
ENDS, EARLY, NOT_FINITE = 100, 101, 102  # as in engine.c, beside the status of FMI


@dataclass(frozen=True)
class Port:
    """The values behind some variables of an FMU, in a fixed buffer.

    Attributes
    ----------
    references : ctypes array of uint32
        Value references, one per variable; an array variable has one.
    values : ctypes array of double
        The values, arrays row by row.
    places : tuple of int
        For every name asked for, its place among the values.
    """

    references: Any
    values: Any
    places: tuple[int, ...]


class Slave:
    """An instance in step mode or on its way there.

    Parameters
    ----------
    stack : ExitStack
        Frees the instance, its library and its temporary folder.
    archive : Path
        The ``.fmu``.
    name : str
        Name of the instance.
    parameters : mapping of str to float
        Values to set before initialisation.
    inputs, outputs : sequence of str
        Names of the variables to set and to read; ``x[2]`` is the second element of an array
        ``x``.

    guarded : bool
        Look at every output of a step: it must be finite.
    shelf : Shelf, optional
        Where libraries come from and go to.

    Attributes
    ----------
    said : str
        What the FMU last said was wrong; empty if it said nothing.

    Raises
    ------
    InputError
        If the archive cannot be read, is not for this platform, lacks one of the variables, or refuses to be
        instantiated or initialised.
    RunError
        If there is no room to unpack it.
    """

    def __init__(
        self,
        stack: contextlib.ExitStack,
        archive: Path,
        name: str,
        parameters: Mapping[str, float],
        inputs: Sequence[str],
        outputs: Sequence[str],
        *,
        guarded: bool = False,
        shelf: loaded.Shelf | None = None,
    ) -> None:
        self.name = name
        self.guarded = guarded
        self.said = ""
        self._archive = archive
        description = describe(archive)
        if description.coSimulation is None:
            raise InputError(f"{archive}: expected an FMU for co-simulation")
        self.version = int(description.fmiVersion[0])
        self._variables = {v.name: v for v in description.modelVariables}
        self.inputs, self.outputs = self._port(inputs), self._port(outputs)
        settings = self._settings(parameters)
        self.fmu = (shelf.library if shelf else loaded.anew)(stack, archive, description, name)
        try:
            self._instantiate(stack)
            stack.callback(self._free)
        except Exception as error:  # as bare as FMPy has it
            why = line(error).replace(self.fmu.unzipDirectory, str(archive))
            raise InputError(f"{archive}: cannot be loaded: {why}{self.reason}") from None
        try:
            self._initialize(settings)
        except FMICallException as error:
            raise InputError(f"{archive}: cannot be initialised: {error}{self.reason}") from None

    def restart(self, parameters: Mapping[str, float]) -> None:
        """Take the instance back to its start, and give it these parameters; nothing is loaded anew.

        Raises
        ------
        RunError
            If it refuses.
        """
        self.said = ""
        try:
            self.fmu.reset()
            self._initialize(self._settings(parameters))
        except FMICallException as error:
            raise RunError(f"{self._archive}: cannot be started again: {error}{self.reason}") from None

    @property
    def reason(self) -> str:
        """What the FMU said was wrong, to go behind a sentence about it."""
        return f" ({self.said})" if self.said else ""

    def hear(self, status: int, message: bytes | None) -> None:
        """Log a message of the FMU, and note one that is worse than a warning."""
        text = line((message or b"").decode("utf-8", "replace"))
        _messages.info("%s: %s", self.name, text)
        if status > 1:
            self.said = text

    def _instantiate(self, stack: contextlib.ExitStack) -> None:
        if self.version == 2:
            _listening[id(self)] = self
            stack.callback(_listening.pop, id(self))
            callbacks = fmi2.fmi2CallbackFunctions.from_buffer_copy(_callbacks)
            callbacks.componentEnvironment = id(self)
            self.fmu.instantiate(callbacks=callbacks)
        else:
            self.fmu.instantiate(logMessage=lambda _, status, __, message: self.hear(status, message))

    def _initialize(self, settings: Port) -> None:
        if self.version == 2:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=0.0)
        self._set(settings)

    def _settings(self, parameters: Mapping[str, float]) -> Port:
        settings = self._port(list(parameters))
        for place, value in zip(settings.places, parameters.values(), strict=True):
            settings.values[place] = value
        return settings

    def _free(self) -> None:
        if self.version == 2:
            self.fmu.fmi2FreeInstance(self.fmu.component)
        else:
            self.fmu.fmi3FreeInstance(self.fmu.component)

    def _port(self, names: Sequence[str]) -> Port:
        first: dict[str, int] = {}  # variable to the place of its first value
        starts: list[float] = []
        places = []
        for name in names:
            variable, element = resolve(self._archive, self._variables, name, self.name)
            if variable.name not in first:
                first[variable.name] = len(starts)
                starts += _starts(self._archive, variable)
            places.append(first[variable.name] + element)
        references = [self._variables[n].valueReference for n in first]
        return Port(
            (ctypes.c_uint32 * len(references))(*references),
            (ctypes.c_double * len(starts))(*starts),
            tuple(places),
        )

    def exchange(self) -> None:
        """Set the inputs and read the outputs without stepping (initialisation)."""
        self._set(self.inputs)
        self._get(self.outputs)

    def exit_initialization(self) -> None:
        """Begin to step."""
        self.fmu.exitInitializationMode()

    def step(self, time: float, h: float) -> int:
        """Set the inputs, step from ``time`` to ``time + h``, read the outputs; return the status."""
        try:
            self._set(self.inputs)
            told = self.fmu.doStep(time, h)
            if self.version == 3:
                _, terminate, early, _ = told
                if terminate or early:
                    return ENDS if terminate else EARLY
            self._get(self.outputs)
        except FMICallException as error:
            return int(error.status)
        if self.guarded and not all(map(math.isfinite, self.outputs.values)):
            return NOT_FINITE
        return 0

    def _set(self, port: Port) -> None:
        n = len(port.references)
        if not n:
            return
        if self.version == 2:
            self.fmu.fmi2SetReal(self.fmu.component, port.references, n, port.values)
        else:
            self.fmu.fmi3SetFloat64(self.fmu.component, port.references, n, port.values, len(port.values))

    def _get(self, port: Port) -> None:
        n = len(port.references)
        if self.version == 2:
            self.fmu.fmi2GetReal(self.fmu.component, port.references, n, port.values)
        else:
            self.fmu.fmi3GetFloat64(self.fmu.component, port.references, n, port.values, len(port.values))


_listening: dict[int, Slave] = {}  # FMI 2.0 instances by what they pass to the logger


def _log(environment: int | None, name: bytes, status: int, category: bytes, message: bytes) -> None:
    if environment in _listening:
        _listening[environment].hear(status, message)
    else:  # an instance of somebody else in this process
        printLogMessage(environment, name, status, category, message)


def _make_callbacks() -> fmi2.fmi2CallbackFunctions:
    # A logger of FMI 2.0 has variable arguments, which only C can format: FMPy has one proxy per process.
    callbacks = fmi2.fmi2CallbackFunctions.from_buffer_copy(fmi2.defaultCallbacks)
    callbacks.logger = _logger
    with contextlib.suppress(Exception):  # not built for this platform: messages are left unformatted
        from fmpy.logging import addLoggerProxy

        addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


_logger = fmi2.fmi2CallbackLoggerTYPE(_log)
_callbacks = _make_callbacks()


def _starts(archive: Path, variable: Any) -> list[float]:
    """Start values of a variable, as many as it has elements."""
    count = size(variable)
    if not 0 <= count <= _MOST:
        raise InputError(
            f"{archive}: variable {quote(variable.name)} has {count} elements; expected at most {_MOST}"
        )
    texts = str(variable.start if variable.start is not None else "0").split()
    try:
        values = [float(text) for text in texts]
    except ValueError:
        raise InputError(
            f"{archive}: variable {quote(variable.name)} starts at {quote(variable.start)}; expected numbers"
        ) from None
    return values if len(values) == count else [values[0] if values else 0.0] * count
