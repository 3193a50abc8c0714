"""An FMU in its place in the loop: what its description says, and whether it fits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fit import units
from fit.errors import quote
from fit.files import closest_match
from lpfcosim.cosim import archive
from lpfcosim.cosim.values import REALS, Value, base_unit, converted, other_unit
from lpfcosim.errors import InputError
from lpfcosim.messages import grouped, line
from lpfcosim.models import model_of
from lpfcosim.network import Component, check_feedthrough
from lpfcosim.spacecraft import Replacement, Run


@dataclass(frozen=True)
class Interface:
    """An FMU in its place in the loop.

    Attributes
    ----------
    component : Component
        Its place; inputs and outputs by our names.
    archive : Path
        The ``.fmu``.
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
    description: Any
    variables: Mapping[str, Any]
    units: Mapping[str, dict[str, str]]
    settings: tuple[str, ...] = ()
    replacement: Replacement | None = None
    faults: tuple[str, ...] = ()

    @property
    def version(self) -> str:
        """Version of FMI."""
        return str(self.description.fmiVersion)

    @property
    def named(self) -> Path:
        """The user's file, of which `archive` may be a copy."""
        return self.replacement.path if self.replacement else self.archive

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

    @property
    def values(self) -> Mapping[str, Value]:
        """What the user sets, by the FMU's names."""
        return self.replacement.values if self.replacement else {}

    def parameters(self, values: Mapping[str, float]) -> dict[str, Value]:
        """Return what is to be set, by the FMU's names: ours as far as it takes them, then its own.

        InputError if a value is not one of its variable.
        """
        ours: dict[str, Value] = {self.name(n): v for n, v in values.items() if self.takes(n)}
        if self.replacement is None:
            return ours
        places = {name: f"variable '{name}'" for name in ours} | {n: f"values.{n}" for n in self.values}
        return {
            name: converted(self.variable(name), value, f"{self.named}: {places[name]}")
            for name, value in {**ours, **self.values}.items()
        }

    @property
    def open_inputs(self) -> dict[str, Value]:
        """The FMU's inputs that nothing feeds, and their start values."""
        fed = {reference(self.variable(name)) for name in self.inputs}
        return {
            name: self.start(name)
            for name, variable in self.variables.items()
            if variable.causality == "input" and reference(variable) not in fed
        }

    def start(self, name: str) -> Value:
        """Return the start value of a variable: that of the user, else that of the description, else zero."""
        return self.values.get(name, self.variables[name].start or 0)

    @property
    def own_step(self) -> float | None:
        """The step that the FMU is made for [s]: that of the user, else its fixed or its default one."""
        simulation, experiment = self.description.coSimulation, self.description.defaultExperiment
        stated = simulation.fixedInternalStepSize or (experiment and experiment.stepSize)
        stated = (self.replacement and self.replacement.step) or stated
        try:
            return float(stated) if stated else None
        except ValueError:  # in an archive that is not valid
            return math.nan

    def n_steps(self, h: float) -> int:
        """Return in how many steps of its own the FMU covers one of the loop, of ``h`` seconds.

        InputError if it takes no step but its own, and that does not divide the step of the loop.
        """
        step, simulation = self.own_step, self.description.coSimulation
        if step is None:
            return 1
        n = h / step if step > 0 else math.nan
        if 1 - 1e-6 < n < 1e6 and abs(n - round(n)) < 1e-6 * n:
            return round(n)
        is_free = (
            simulation.fixedInternalStepSize is None and simulation.canHandleVariableCommunicationStepSize
        )
        if is_free and not (self.replacement and self.replacement.step):
            return 1
        raise InputError(
            f"{self.named}: steps by {step:g} s; expected a step that divides that of the loop, {h:g} s"
        )

    def variable(self, name: str) -> Any:
        """Return FMPy's record of a scalar; InputError if there is none of this name, or it is an array."""
        if name not in self.variables:
            raise InputError(f"{self.named}: variable '{name}' is missing; expected of the {self.model}")
        if self.variables[name].dimensions:
            raise InputError(f"{self.named}: variable '{name}' is an array; expected a scalar")
        return self.variables[name]

    def candidates(self, causality: str) -> list[str]:
        """Return the names of its variables of a causality."""
        return [v.name for v in self.variables.values() if v.causality == causality]

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
        outputs = self.description.outputs if self.replacement else ()
        dependencies = {reference(u.variable): u.dependencies for u in outputs}
        feedthrough = {}
        for output in self.component.outputs:
            depends_on = dependencies.get(reference(self.variable(self.name(output))))
            references = {reference(v) for v in depends_on or ()}
            feedthrough[output] = (
                self.component.direct[output]
                if depends_on is None
                else [
                    v for v in self.component.inputs if reference(self.variable(self.name(v))) in references
                ]
            )
        return feedthrough


def reference(variable: Any) -> tuple[str, int]:
    """Return what identifies the memory behind a variable; FMI 2.0 numbers each base type by itself."""
    kind = "Integer" if variable.type == "Enumeration" else variable.type
    return str(kind), int(variable.valueReference)


def read(
    component: Component, path: Path, settings: Iterable[str], replacement: Replacement | None
) -> Interface:
    """Read the description of an FMU for its place; InputError if that cannot be done."""
    named = replacement.path if replacement else path
    description, faults = archive.describe(path, named, validate=replacement is None or replacement.validate)
    if description.fmiVersion[:2] not in ("2.", "3."):
        raise InputError(f"{named}: is FMI {description.fmiVersion}; expected 2.0 or 3.0")
    if description.coSimulation is None or not description.coSimulation.modelIdentifier:
        raise InputError(f"{named}: expected an FMU for co-simulation")
    if not description.instantiationToken:
        raise InputError(f"{named}: its modelDescription.xml has no guid or instantiationToken; expected one")
    variables = {v.name: v for v in description.modelVariables}
    base_units = {
        u.name: base_unit(u.baseUnit) for u in description.unitDefinitions if u.baseUnit is not None
    }
    return Interface(
        component, path, description, variables, base_units, tuple(settings), replacement, faults
    )


def read_interfaces(run: Run, fmus: Mapping[str, Path]) -> list[Interface]:
    """Read the descriptions of the FMUs of a run, in the order of their steps, and check that they fit.

    Their code is not loaded.

    Parameters
    ----------
    run : Run
        Gives parameters, step and what is put in the place of ours.
    fmus : mapping of str to Path
        The FMU of each component, the file itself or a copy; a component without one is not read.

    Raises
    ------
    InputError
        If an FMU cannot be read or does not fit, or closes an algebraic loop; with table and file.
    """
    replaced, interfaces = {r.model: r for r in run.replacements}, []
    spacecraft = model_of(run)
    settings = spacecraft.parameters(run)
    direct: dict[str, Mapping[str, Iterable[str]]] = {}
    for component in spacecraft.components(run):
        if component.model not in fmus:
            direct[component.model] = component.direct
            continue
        replacement, values = replaced.get(component.model), settings[component.model]
        try:
            interface = read(component, fmus[component.model], values, replacement)
            _check(interface, spacecraft.units, values, run.h)
        except InputError as error:
            place = f"fmus.{component.model}: " if replacement else ""
            raise InputError(f"{place}{error}") from None
        interfaces.append(interface)
        direct[component.model] = interface.direct
    check_feedthrough(spacecraft.components(run), direct)
    return interfaces


def read_interfaces_of_runs(runs: Sequence[Run], fmus: Mapping[str, Path]) -> list[Interface]:
    """Do as `read_interfaces` for all runs of a campaign, and return the interfaces of the first.

    An InputError gives the names of the runs, whose parameters may differ, unless it is the same for all.
    """
    interfaces: list[list[Interface]] = []
    refused: list[tuple[str, str]] = []
    for run in runs:
        try:
            interfaces.append(read_interfaces(run, fmus))
        except InputError as error:
            refused.append((run.name, str(error)))
    causes = {cause for _, cause in refused}
    if refused:
        common = len(refused) == len(runs) and len(causes) == 1
        raise InputError(causes.pop() if common else "; ".join(grouped(refused)))
    return interfaces[0]


def warnings(interfaces: Iterable[Interface], h: float) -> list[str]:
    """Return what users should know of their FMUs in a loop of step ``h`` [s], a sentence each."""
    sentences = []
    for interface in interfaces:
        if interface.replacement is None:
            continue
        place = f"fmus.{interface.model}: {interface.named}"
        if interface.faults:
            fault = archive.nonconformity(interface.faults)
            sentences.append(f"{place}: {fault}; accepted because of validate = false")
        if interface.open_inputs:
            listed = ", ".join(
                f"{line(name)} = {line(value)}" for name, value in interface.open_inputs.items()
            )
            sentences.append(f"{place}: open inputs, at their start values: {listed}")
        step, n = interface.own_step, interface.n_steps(h)
        if n > 1:
            sentences.append(f"{place}: takes {n} steps of {step:g} s in each step of the loop, {h:g} s")
        elif step is not None and not math.isclose(step, h, rel_tol=1e-6):
            sentences.append(f"{place}: is stepped by {h:g} s; its default step is {step:g} s")
    return sentences


def ignored_names(interfaces: Iterable[Interface]) -> dict[str, tuple[str, ...]]:
    """Of every replaced component, inputs and parameters of ours that the FMU in its place does not take."""
    return {i.model: i.ignored for i in interfaces if i.replacement}


def _check(interface: Interface, unit_of: Mapping[str, str], values: Mapping[str, float], h: float) -> None:
    """Refuse an FMU that does not fit its place; the arguments are units, parameters in SI, step [s]."""
    parameters = [name for name in interface.settings if interface.takes(name)]
    for names, causality in (
        (interface.component.inputs, "input"),
        (interface.component.outputs, "output"),
        (parameters, "parameter"),
    ):
        for name in names:
            _check_variable(interface, name, causality)
            if interface.replacement:  # ours have the units of the place, from the same Modelica
                _check_unit(interface, name, unit_of[name])
    for name in interface.values:
        _check_settable(interface, name)
    _check_once(interface, parameters)
    interface.parameters(values)
    interface.n_steps(h)
    archive.check_platform(interface.archive, interface.description, interface.named)


def _check_variable(interface: Interface, ours: str, causality: str) -> None:
    """Refuse a variable for one of ours that is missing, or of another causality or type."""
    name = interface.name(ours)
    if name not in interface.variables:
        known = line(closest_match(name, interface.candidates(causality)))
        raise InputError(
            f"{interface.named}: variable '{name}' is missing, the {causality} for {ours}{known}"
        )
    variable = interface.variable(name)
    place = f"{interface.named}: variable '{name}'"
    if variable.causality != causality or variable.variability == "constant":
        constant = variable.variability == "constant"
        attribute = "constant" if constant else f"of causality '{line(variable.causality)}'"
        raise InputError(f"{place} is {attribute}; expected causality '{causality}' for {ours}")
    kind = "Real" if interface.version.startswith("2") else "Float64"
    if variable.type != kind and not (causality == "parameter" and variable.type in REALS):
        raise InputError(f"{place} is of type {line(variable.type)}; expected {kind} for {ours}")


def _check_settable(interface: Interface, name: str) -> None:
    """Refuse a variable under ``values`` that FMI does not let be set before initialization mode."""
    fixed = ("constant", "structuralParameter")
    settable = [
        v.name
        for v in interface.variables.values()
        if v.variability not in fixed and v.causality not in fixed
        if v.causality in ("input", "parameter") or v.initial in ("exact", "approx")
    ]
    if name not in settable:
        known = line(closest_match(name, settable))
        raise InputError(
            f"{interface.named}: values names {quote(name)}, expected a parameter, an input or a variable "
            f"with a start value{known}"
        )


def _check_once(interface: Interface, parameters: Iterable[str]) -> None:
    """Refuse a variable that would be set from two sides, be it under two names."""
    set_by: dict[tuple[str, int], str] = {}
    for name in (*interface.inputs, *map(interface.name, parameters), *interface.values):
        place = reference(interface.variable(name))
        if place in set_by:
            raise InputError(f"{interface.named}: '{name}' is set twice, also as '{set_by[place]}'")
        set_by[place] = name


def _check_unit(interface: Interface, ours: str, expected: str) -> None:
    """Refuse a variable in another unit than ours; one that states none is taken to be in ours."""
    name = interface.name(ours)
    unit = interface.stated_unit(name)
    if unit is None:
        return
    place = f"{interface.named}: variable '{name}' is in {line(unit)}"
    base = interface.units.get(unit)
    if base is None and not units.same_unit(unit, expected):
        raise InputError(
            f"{place}, of which it does not give the base units; expected {expected}, for {ours}"
        )
    if base is not None and (meaning := other_unit(base, expected)):
        raise InputError(f"{place}, by which it means {meaning}; expected {expected}, for {ours}")
