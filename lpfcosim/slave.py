"""One FMU of the loop, FMI 2.0 or 3.0: FMPy loads, checks, initialises and frees it."""

from __future__ import annotations

import contextlib
import ctypes
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from lpfcosim.errors import InputError

_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


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
        Names of the variables to set and to read; ``x[2]`` may be the second element of an array ``x``.

    Raises
    ------
    InputError
        If the archive cannot be read, is not for this platform, or lacks one of the variables.
    """

    def __init__(
        self,
        stack: contextlib.ExitStack,
        archive: Path,
        name: str,
        parameters: Mapping[str, float],
        inputs: Sequence[str],
        outputs: Sequence[str],
    ) -> None:
        self.name = name
        self._archive = archive
        try:
            description = fmpy.read_model_description(str(archive))
            folder = fmpy.extract(str(archive))
        except Exception as error:  # FMPy raises bare exceptions for broken archives
            raise InputError(f"{archive}: not a readable FMU: {error}") from None
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        self.version = int(description.fmiVersion[0])
        self._variables = {v.name: v for v in description.modelVariables}
        self.inputs, self.outputs = self._port(inputs), self._port(outputs)
        settings = self._port(list(parameters))
        kind = FMU2Slave if self.version == 2 else FMU3Slave
        try:
            self.fmu = kind(
                instanceName=name,
                guid=description.guid,
                unzipDirectory=folder,
                modelIdentifier=description.coSimulation.modelIdentifier,
            )
        except Exception as error:  # likewise bare
            raise InputError(f"{archive}: cannot be loaded: {error}") from None
        stack.callback(self.fmu.freeLibrary)
        self.fmu.instantiate()
        stack.callback(self._free)
        if self.version == 2:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=0.0)
        for place, value in zip(settings.places, parameters.values(), strict=True):
            settings.values[place] = value
        if parameters:
            self._set(settings)

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
            variable, element = self._resolve(name)
            if variable.name not in first:
                first[variable.name] = len(starts)
                starts += _starts(variable)
            places.append(first[variable.name] + element)
        references = [self._variables[n].valueReference for n in first]
        return Port(
            (ctypes.c_uint32 * len(references))(*references),
            (ctypes.c_double * len(starts))(*starts),
            tuple(places),
        )

    def _resolve(self, name: str) -> tuple[Any, int]:
        """Variable and element that a name means."""
        if name in self._variables:
            return self._variables[name], 0
        match = _ELEMENT.fullmatch(name)
        if match and match[1] in self._variables:
            variable, element = self._variables[match[1]], int(match[2]) - 1
            if 0 <= element < len(_starts(variable)):
                return variable, element
        raise InputError(f"{self._archive}: variable '{name}' is missing; expected of the {self.name}")

    def exchange(self) -> None:
        """Set the inputs and read the outputs without stepping (initialisation)."""
        self._set(self.inputs)
        self._get(self.outputs)

    def exit_initialization(self) -> None:
        """Begin to step."""
        self.fmu.exitInitializationMode()

    def step(self, time: float, h: float) -> None:
        """Set the inputs, step from ``time`` to ``time + h``, read the outputs."""
        self._set(self.inputs)
        self.fmu.doStep(time, h)
        self._get(self.outputs)

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


def _starts(variable: Any) -> list[float]:
    """Start values of a variable, as many as it has elements."""
    size = 1
    for extent in variable.shape or ():
        size *= int(extent)
    texts = str(variable.start if variable.start is not None else "0").split()
    values = [float(t) for t in texts]
    return values if len(values) == size else [values[0] if values else 0.0] * size
