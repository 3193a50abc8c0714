"""What an FMU says of itself, read for its place in the loop."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import fmpy
from fmpy.model_description import ValidationError

from fit.errors import quote
from lpfcosim.cosim import archive as archives
from lpfcosim.cosim.variables import Value, convert, resized, resolve, start_values
from lpfcosim.errors import InputError
from lpfcosim.messages import line
from lpfcosim.network import Component
from lpfcosim.spacecraft import Replacement

_LONGEST_NAME = 200  # bytes, of a binary without its extension
BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


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
    faults : tuple of str
        Of its description against the schema and the rules of FMI, which the user accepts.
    """

    component: Component
    archive: Path
    version: str
    description: Any
    variables: Mapping[str, Any]
    units: Mapping[str, dict[str, str]]
    settings: tuple[str, ...] = ()
    replacement: Replacement | None = None
    faults: tuple[str, ...] = ()

    @property
    def named(self) -> Path:
        """The user's file, of which `archive` may be a copy."""
        return self.replacement.archive if self.replacement else self.archive

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
        """Return whether the FMU has a parameter of our name, or one the user names for it."""
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

    def parameters(self, values: Mapping[str, float]) -> dict[str, Value]:
        """Return what is to be set, by the FMU's names: ours as far as it takes them, then its own.

        Raises
        ------
        InputError
            If a value is not one of its variable.
        """
        values_by_name: dict[str, Value] = {self.name(n): v for n, v in values.items() if self.takes(n)}
        if self.replacement is None:
            return values_by_name
        user_values = self.replacement.values
        for name, value in {**values_by_name, **user_values}.items():
            variable = self.variable(name)
            place = f"values.{name}" if name in user_values else f"variable '{name}'"
            values_by_name[name] = _converted(variable, value, place, self.named)
        return values_by_name

    def place(self, name: str) -> tuple[tuple[str, int], int]:
        """Return what aliases share that a name of the FMU means: `reference` and element."""
        variable, element = resolve(self.named, self.variables, name, self.model)
        return reference(variable), element

    def start_values(self, variable: Any) -> list[Value]:
        """Return the value of each element of a variable, row by row, until the loop sets it.

        Raises
        ------
        InputError
            If a start value of the description, or a value that the user gives, is not one of the type.
        """
        if variable.type == "String" and variable.shape:
            texts = _strings(self.archive, variable.name)
        elif variable.type == "String":
            texts = [variable.start or ""]
        else:
            texts = str(variable.start if variable.start is not None else "").split()
        values = start_values(self.named, variable, texts)
        for name, value in (self.replacement.values if self.replacement else {}).items():
            variable_reference, element = self.place(name)
            if variable_reference == reference(variable):
                values[element] = _converted(variable, value, f"values.{name}", self.named)
        return values

    def variable(self, name: str) -> Any:
        """Return FMPy's record of the variable that a name of the FMU means; the name may be an element's."""
        return resolve(self.named, self.variables, name, self.model)[0]

    def candidates(self, *causalities: str) -> list[str]:
        """Return the FMU's names of its variables of some causalities."""
        return [v.name for v in self.variables.values() if v.causality in causalities]

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

        Ours are known: what `moves` has none, the others have all. Of another FMU its description is used;
        what it leaves open is taken like ours.
        """
        dependencies = (
            {u.variable.name: u.dependencies for u in self.description.outputs} if self.replacement else {}
        )
        feedthrough = {}
        for output in self.component.outputs:
            depends_on = dependencies.get(self.variable(self.name(output)).name)
            names = None if depends_on is None else {v.name for v in depends_on}
            feedthrough[output] = (
                self.component.direct[output]
                if names is None
                else [v for v in self.component.inputs if self.variable(self.name(v)).name in names]
            )
        return feedthrough


def reference(variable: Any) -> tuple[str, int]:
    """Return what identifies the memory behind a variable; FMI 2.0 numbers each base type by itself."""
    kind = "Integer" if variable.type == "Enumeration" else variable.type
    return str(kind), int(variable.valueReference)


def _converted(variable: Any, value: Value, place: str, named: Path) -> Value:
    """Return a value as the type of a variable has it; an InputError gives the `place` of the value."""
    try:
        return convert(variable, value)
    except InputError as error:
        raise InputError(f"{place}: {error}, for {named}") from None


def _strings(archive: Path, name: str) -> list[str]:
    """Return the start values of an array of strings, of which FMPy reads the first alone."""
    with zipfile.ZipFile(archive) as file:
        root = ET.fromstring(file.read("modelDescription.xml"))
    for variable in root.iter("String"):
        if name in (variable.get("name"), *(alias.get("name") for alias in variable.iter("Alias"))):
            return [start.get("value", "") for start in variable.iter("Start")]
    return []


def read(
    component: Component, archive: Path, settings: Iterable[str], replacement: Replacement | None
) -> Interface:
    """Read the description of an FMU for its place; InputError if that cannot be done."""
    named = replacement.archive if replacement else archive
    validate = replacement is None or replacement.validate
    description, faults = describe(archive, named, validate=validate)
    if description.fmiVersion[:2] not in ("2.", "3."):
        raise InputError(f"{named}: is FMI {description.fmiVersion}; expected 2.0 or 3.0")
    if description.coSimulation is None or not description.coSimulation.modelIdentifier:
        also = " (it is one for model exchange)" if description.modelExchange else ""
        raise InputError(f"{named}: expected an FMU for co-simulation{also}")
    identifier = description.coSimulation.modelIdentifier
    if len(identifier.encode()) > _LONGEST_NAME or set(identifier) & set("/\\"):
        raise InputError(
            f"{named}: has the model identifier {quote(identifier)}; expected one that names a file"
        )
    variables = {v.name: v for v in description.modelVariables}
    user_values = replacement.values if replacement else {}
    structure = {n: v for n, v in user_values.items() if n in variables and _is_structural(variables[n])}
    return Interface(
        component,
        archive,
        description.fmiVersion,
        description,
        resized(
            variables,
            {n: _converted(variables[n], v, f"values.{n}", named) for n, v in structure.items()},
        ),
        {u.name: _base(u.baseUnit) for u in description.unitDefinitions if u.baseUnit is not None},
        tuple(settings),
        replacement,
        faults,
    )


def _is_structural(variable: Any) -> bool:
    return bool(variable.causality == "structuralParameter")


def describe(
    archive: Path, named: Path | None = None, *, validate: bool = True
) -> tuple[Any, tuple[str, ...]]:
    """Return FMPy's model description of an archive, and its faults against the FMI schema.

    Parameters
    ----------
    archive : Path
        The ``.fmu``.
    named : Path, optional
        What messages call it, if it is a copy.
    validate : bool
        Refuse one that is not valid, so that no fault remains.

    Raises
    ------
    InputError
        If it cannot be read, or is not valid and should be.
    """
    try:
        status = archive.stat()
    except OSError as error:
        raise InputError(f"{named or archive}: not a readable FMU: {error.strerror}") from None
    description, faults = _describe(archive, named or archive, status.st_mtime_ns, status.st_size)
    if faults and validate:
        raise InputError(
            f"{named or archive}: {nonconformity(faults)}; correct the archive, or accept it as it is with "
            "validate = false in its table [fmus.MODEL] of the campaign"
        )
    return description, faults


def nonconformity(faults: Sequence[str]) -> str:
    """Return one line about the faults of a description against the FMI schema."""
    suffix = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    return (
        f"its modelDescription.xml does not conform to the FMI schema: {line(faults[0]).rstrip('.')}{suffix}"
    )


@lru_cache(maxsize=32)
def _describe(archive: Path, named: Path, _changed: int, _size: int) -> tuple[Any, tuple[str, ...]]:
    archives.check(archive, named)
    try:
        return _read(archive, validate=True), ()
    except Exception as error:  # FMPy raises bare exceptions for broken archives
        fault = error
    try:
        description = _read(archive, validate=False)
        usable = all(v.name and v.type for v in description.modelVariables)
    except Exception:
        usable = False
    if not usable:
        raise InputError(f"{named}: not a readable FMU: {line(fault)}") from None
    faults = fault.problems if isinstance(fault, ValidationError) else [_spelled(fault)]
    return description, tuple(map(str, faults))


def _read(archive: Path, *, validate: bool) -> Any:
    with archive.open("rb") as file:  # by name, FMPy would leave open what it fails on
        return fmpy.read_model_description(file, validate=validate)


def _spelled(fault: Exception) -> str:
    if isinstance(fault, KeyError):  # FMPy looks up the unit of a display unit
        return f"the unit {fault} is not defined"
    return str(fault)


def _base(unit: Any) -> dict[str, str]:
    attributes = {name: str(getattr(unit, name)) for name in BASE_UNITS if getattr(unit, name)}
    defaults = {"factor": 1.0, "offset": 0.0}
    return attributes | {n: repr(getattr(unit, n)) for n, v in defaults.items() if getattr(unit, n) != v}
