"""What an FMU says of itself, read for its place in the loop."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import fmpy

from lpfcosim.cosim import archive as archives
from lpfcosim.errors import InputError
from lpfcosim.messages import line
from lpfcosim.network import Component
from lpfcosim.spacecraft import Replacement

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_ELEMENT = re.compile(r"(.+)\[(\d+(?:\s*,\s*\d+)*)\]")


@dataclass(frozen=True)
class Interface:
    """An FMU in its place in the loop.

    Attributes
    ----------
    component : Component
        Its place; inputs and outputs by our names.
    archive : Path
        The ``.fmu``.
    version : str
        Version of FMI.
    description : object
        FMPy's model description.
    variables : dict of str to object
        FMPy's records of the variables, by name.
    units : dict of str to dict
        Attributes of the ``BaseUnit`` element of every unit that has one, by name.
    settings : tuple of str
        Our names of the parameters that its place has.
    replacement : Replacement or None
        What the user says of an FMU that is not ours.
    """

    component: Component
    archive: Path
    version: str
    description: Any
    variables: Mapping[str, Any]
    units: Mapping[str, dict[str, str]]
    settings: tuple[str, ...] = ()
    replacement: Replacement | None = None

    @property
    def model(self) -> str:
        """Name of its component."""
        return self.component.model

    def name(self, ours: str) -> str:
        """Return the FMU's name for a variable of ours."""
        return self.replacement.variables.get(ours, ours) if self.replacement else ours

    @property
    def inputs(self) -> list[str]:
        """The FMU's names of the inputs, in the order of the component."""
        return [self.name(v) for v in self.component.inputs]

    @property
    def outputs(self) -> list[str]:
        """The FMU's names of the outputs, in the order of the component."""
        return [self.name(v) for v in self.component.outputs]

    def takes(self, ours: str) -> bool:
        """Tell whether the FMU has a parameter of our name, or one the user names for it."""
        if self.replacement is None or ours in self.replacement.variables:
            return True
        if ours in (*self.replacement.unused, *self.replacement.variables.values()):
            return False
        variable = self.variables.get(ours)
        return variable is not None and variable.causality == "parameter"

    @property
    def ignored(self) -> tuple[str, ...]:
        """Inputs and parameters of ours that the FMU in the place of ours does not take."""
        unused = self.replacement.unused if self.replacement else ()
        return tuple(dict.fromkeys([*unused, *(name for name in self.settings if not self.takes(name))]))

    def parameters(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return what is to be set, by the FMU's names: ours as far as it takes them, then its own."""
        own = self.replacement.values if self.replacement else {}
        return {self.name(n): v for n, v in values.items() if self.takes(n)} | dict(own)

    def place(self, name: str) -> tuple[int, int]:
        """Return value reference and element, which aliases share, that a name of the FMU means."""
        variable, element = resolve(self.archive, self.variables, name, self.model)
        return variable.valueReference, element

    def variable(self, name: str) -> Any:
        """Return FMPy's record of the variable that a name of the FMU means; the name may be an element's."""
        return resolve(self.archive, self.variables, name, self.model)[0]

    def unit(self, name: str) -> str | None:
        """Return the unit of a variable, if it has one that the FMU defines in SI."""
        unit = self.stated_unit(name)
        return unit if unit in self.units else None

    def stated_unit(self, name: str) -> str | None:
        """Return the name of the unit of a variable, if it has one."""
        variable = self.variable(name)
        return variable.unit or (variable.declaredType.unit if variable.declaredType else None)

    @property
    def direct(self) -> dict[str, list[str]]:
        """Our outputs, each with those of our inputs that it follows from at once.

        Ours are known: what `moves` has none, the others have all. Of another FMU its description tells; what
        it leaves open is taken like ours.
        """
        told = {u.variable.name: u.dependencies for u in self.description.outputs} if self.replacement else {}
        found = {}
        for output in self.component.outputs:
            on = told.get(self.variable(self.name(output)).name)
            names = None if on is None else {v.name for v in on}
            found[output] = (
                self.component.direct[output]
                if names is None
                else [v for v in self.component.inputs if self.variable(self.name(v)).name in names]
            )
        return found


def read(
    component: Component, archive: Path, settings: Iterable[str], replacement: Replacement | None
) -> Interface:
    """Read the description of an FMU for its place; InputError if that cannot be done."""
    description = describe(archive)
    if description.fmiVersion[:2] not in ("2.", "3."):
        raise InputError(f"{archive}: is FMI {description.fmiVersion}; expected 2.0 or 3.0")
    if description.coSimulation is None:
        raise InputError(f"{archive}: expected an FMU for co-simulation")
    return Interface(
        component,
        archive,
        description.fmiVersion,
        description,
        {v.name: v for v in description.modelVariables},
        {u.name: _base(u.baseUnit) for u in description.unitDefinitions if u.baseUnit is not None},
        tuple(settings),
        replacement,
    )


def describe(archive: Path) -> Any:
    """Return FMPy's model description of an archive; InputError if it cannot be read."""
    try:
        status = archive.stat()
    except OSError as error:
        raise InputError(f"{archive}: not a readable FMU: {error.strerror}") from None
    return _describe(archive, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=32)
def _describe(archive: Path, _changed: int, _size: int) -> Any:
    archives.check(archive)
    try:
        return fmpy.read_model_description(str(archive))
    except Exception as error:  # FMPy raises bare exceptions for broken archives
        raise InputError(f"{archive}: not a readable FMU: {line(error)}") from None


def resolve(archive: Path, variables: Mapping[str, Any], name: str, model: str) -> tuple[Any, int]:
    """Find the variable and the element, counted row by row, that ``x``, ``x[2]`` or ``x[2,1]`` means."""
    if name in variables:
        variable = variables[name]
        if size(variable) != 1:
            extents = " by ".join(str(n) for n in variable.shape)
            raise InputError(
                f"{archive}: variable '{name}' is an array of {extents}; expected one of its elements, such "
                f"as '{name}[{','.join('1' * len(variable.shape))}]'"
            )
        return variable, 0
    match = _ELEMENT.fullmatch(name)
    if match and match[1] in variables:
        variable = variables[match[1]]
        indices, shape = [int(i) - 1 for i in match[2].split(",")], variable.shape or ()
        if len(indices) == len(shape) and all(0 <= i < n for i, n in zip(indices, shape, strict=True)):
            place = 0
            for i, n in zip(indices, shape, strict=True):
                place = place * n + i
            return variable, place
    raise InputError(f"{archive}: variable '{name}' is missing; expected of the {model}")


def size(variable: Any) -> int:
    """Count the elements of a variable."""
    count = 1
    for extent in variable.shape or ():
        count *= int(extent)
    return count


def _base(unit: Any) -> dict[str, str]:
    attributes = {name: str(getattr(unit, name)) for name in BASE_UNITS if getattr(unit, name)}
    defaults = {"factor": 1.0, "offset": 0.0}
    return attributes | {n: repr(getattr(unit, n)) for n, v in defaults.items() if getattr(unit, n) != v}
