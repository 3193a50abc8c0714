"""Do the FMUs fit their places in the loop? Said before anything is simulated."""

from __future__ import annotations

import math
import re
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import fmpy

from lpfcosim.cosim.interface import BASE_UNITS, Interface, read
from lpfcosim.errors import InputError
from lpfcosim.network import Component, check_feedthrough, endpoint
from lpfcosim.spacecraft import Run
from lpfcosim.worlds import world_of

_SYMBOLS: dict[str, dict[str, int]] = {
    **{name: {name: 1} for name in BASE_UNITS},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Hz": {"s": -1},
}
_FACTOR = re.compile(r"([A-Za-z]+)\^?([+-]?\d+)?|1")


def interfaces(run: Run, fmus: Mapping[str, Path]) -> list[Interface]:
    """Read the descriptions of the FMUs of a run, in the order of their steps, and check that they fit.

    Parameters
    ----------
    run : Run
        Gives the parameters, the step size and what is put in the place of ours.
    fmus : mapping of str to Path
        The FMU of each component. Of a component without one, nothing is read but what its place tells.

    Raises
    ------
    InputError
        If an FMU cannot be read, is not for co-simulation, lacks a variable, has it with another causality,
        type or unit, wants other steps, is not for this platform, or closes an algebraic loop.
    """
    replaced = {r.model: r for r in run.replacements}
    found = []
    world = world_of(run)
    settings = world.parameters(run)
    direct: dict[str, Mapping[str, Iterable[str]]] = {}
    for component in world.steps(run):
        if component.model not in fmus:
            direct[component.model] = component.direct
            continue
        replacement = replaced.get(component.model)
        try:
            interface = read(component, fmus[component.model], settings[component.model], replacement)
            _check(interface, world.units, run.h)
        except InputError as error:
            place = f"fmus.{component.model}: " if replacement else ""
            raise InputError(f"{place}{error}") from None
        found.append(interface)
        direct[component.model] = interface.direct
    check_feedthrough(world.steps(run), direct)
    return found


def driver(run: Run, found: Iterable[Interface], archive: Path) -> Interface:
    """Read the FMU that gives the loop what comes from outside, where another tool steps it.

    Raises
    ------
    InputError
        If it lacks a signal.
    """
    sources = (s for i in found for s in i.component.inputs.values() if not endpoint(s)[0])
    component = Component(world_of(run).signals, {}, tuple(dict.fromkeys(sources)))
    interface = read(component, archive, (), None)
    for name in interface.outputs:
        interface.variable(name)
    return interface


def ignored(found: Iterable[Interface]) -> dict[str, tuple[str, ...]]:
    """Of every replaced component, inputs and parameters of ours that the FMU in its place does not take."""
    return {i.model: i.ignored for i in found if i.replacement}


def _check(interface: Interface, units: Mapping[str, str], h: float) -> None:
    parameters = [name for name in interface.settings if interface.takes(name)]
    for names, causality in (
        (interface.component.inputs, "input"),
        (interface.component.outputs, "output"),
        (parameters, "parameter"),
    ):
        for name in names:
            _check_variable(interface, interface.name(name), causality, f" for {name}")
            _check_unit(interface, name, units[name])
    for name in interface.replacement.values if interface.replacement else ():
        _check_variable(interface, name, "parameter", "")
    _check_once(interface, [interface.name(name) for name in parameters])
    _check_step(interface, h)
    _check_platform(interface)


def _check_once(interface: Interface, parameters: Iterable[str]) -> None:
    """Refuse a variable that would be set from two sides, be it under two names."""
    own = interface.replacement.values if interface.replacement else ()
    set_by: dict[tuple[int, int], str] = {}
    for name in (*interface.inputs, *parameters, *own):
        other = set_by.setdefault(interface.place(name), name)
        if other != name:
            raise InputError(f"{interface.archive}: '{other}' and '{name}' are one variable; expected two")


def _check_variable(interface: Interface, name: str, causality: str, purpose: str) -> None:
    try:
        variable = interface.variable(name)
    except InputError as error:
        if not purpose:
            raise InputError(f"{interface.archive}: has no parameter '{name}'") from None
        hint = f" as its {causality}{purpose}" if interface.replacement else ""
        raise InputError(f"{error}{hint}") from None
    place = f"{interface.archive}: variable '{name}'"
    if variable.causality != causality or variable.variability == "constant":
        given = "constant" if variable.variability == "constant" else f"of causality '{variable.causality}'"
        raise InputError(f"{place} is {given}; expected causality '{causality}'{purpose}")
    kind = "Real" if interface.version.startswith("2") else "Float64"
    if variable.type != kind:
        raise InputError(f"{place} is of type {variable.type}; expected {kind}{purpose}")


def _check_unit(interface: Interface, ours: str, wanted: str) -> None:
    """Refuse a variable in another unit than ours; one that tells none is taken to be in ours."""
    name = interface.name(ours)
    unit = interface.stated_unit(name)
    if unit is None:
        return
    base = interface.units.get(unit)
    place = f"{interface.archive}: variable '{name}' is in {unit}"
    if base is None:
        if _exponents(unit) != _exponents(wanted):
            raise InputError(
                f"{place}, of which it does not give the base units; expected {wanted}, for {ours}"
            )
        return
    exponents = {n: int(p) for n, p in base.items() if n in BASE_UNITS}
    factor, offset = float(base.get("factor", 1)), float(base.get("offset", 0))
    if exponents != _exponents(wanted) or abs(factor - 1) > 1e-12 or offset:
        told = f"{factor:g} {wanted}" if exponents == _exponents(wanted) else _spelled(exponents, factor)
        also = f" with an offset of {offset:g}" if offset else ""
        raise InputError(f"{place}, by which it means {told}{also}; expected {wanted}, for {ours}")


def _spelled(exponents: Mapping[str, int], factor: float) -> str:
    product = ".".join(f"{base}{power if power != 1 else ''}" for base, power in exponents.items()) or "1"
    return product if factor == 1 else f"{factor:g} {product}"


def _exponents(unit: str) -> dict[str, int] | None:
    """Exponents of the base units, of a product like ``kg-1.m-2`` or ``m/s^2``; None if it is no such."""
    exponents: dict[str, int] = {}
    for sign, product in zip((1, -1), re.sub("[()]", "", unit.replace("**", "^")).split("/"), strict=False):
        for factor in re.split("[.·* ]+", product.strip()):
            match = _FACTOR.fullmatch(factor)
            if match is None or match[1] not in (None, *_SYMBOLS):
                return None
            for base, power in _SYMBOLS.get(match[1], {}).items():
                exponents[base] = exponents.get(base, 0) + sign * power * int(match[2] or 1)
    return {base: power for base, power in exponents.items() if power} if unit.count("/") < 2 else None


def _check_step(interface: Interface, h: float) -> None:
    """Refuse an FMU whose own step does not divide ours, or that takes no other than the one it names."""
    simulation, experiment = interface.description.coSimulation, interface.description.defaultExperiment
    needed = simulation.fixedInternalStepSize
    if needed is None and not simulation.canHandleVariableCommunicationStepSize and experiment is not None:
        needed = experiment.stepSize
    if needed is None:
        return
    steps = h / float(needed) if float(needed) > h * 1e-9 else math.nan
    if not steps >= 0.5 or abs(steps - round(steps)) > 1e-6:
        raise InputError(
            f"{interface.archive}: steps by {float(needed):g} s; expected a step that divides that of the "
            f"loop, {h:g} s"
        )


def _check_platform(interface: Interface) -> None:
    here = fmpy.platform if interface.version.startswith("2") else fmpy.platform_tuple
    try:
        with zipfile.ZipFile(interface.archive) as archive:
            names = archive.namelist()
    except (OSError, zipfile.BadZipFile) as error:
        raise InputError(f"{interface.archive}: not a readable FMU: {error}") from None
    identifier = interface.description.coSimulation.modelIdentifier
    if f"binaries/{here}/{identifier}{fmpy.sharedLibraryExtension}" in names:
        return
    others = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") > 1})
    given = f"has a binary for {', '.join(others)} only" if others else "has no binary"
    raise InputError(f"{interface.archive}: {given}; expected one for {here}")
