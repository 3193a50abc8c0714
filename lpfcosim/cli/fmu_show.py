"""The command ``fmu show``: what a place of the loop needs, what an FMU has, and how the two fit together."""

from __future__ import annotations

import difflib
import json
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from fit.errors import quote
from fit.files import closest_match
from fit.tables import Table
from lpfcosim.cli.console import Console
from lpfcosim.cosim import Interface, compatibility, compilation, describe, nonconformity, read
from lpfcosim.errors import InputError
from lpfcosim.messages import line
from lpfcosim.models import model_of, registered
from lpfcosim.network import Component
from lpfcosim.spacecraft import Replacement, Run

SCHEMA = "lpf-fmu/1"
_CAUSALITIES = ("input", "output", "parameter", "structuralParameter", "calculatedParameter")
MAX_LISTED = 20  # parameters that are listed
_SIMILAR = 0.75  # of two names, by difflib, from which one is proposed for the other


@dataclass(frozen=True)
class Need:
    """A variable that a place of the loop has.

    Attributes
    ----------
    name, causality, unit, description : str
        As our FMU has them; `causality` is input, output or parameter.
    default : float or None
        Start value of an input; of a parameter, its value with the parameters of flight.
    optional : bool
        Only some campaigns feed it.
    """

    name: str
    causality: str
    unit: str
    default: float | None
    description: str
    optional: bool = False


@dataclass(frozen=True)
class Place:
    """A place of the loop: its run, its component, our FMU in it, and what it needs."""

    run: Run
    component: Component
    ours: Interface
    needs: tuple[Need, ...]


@dataclass(frozen=True)
class Match:
    """How an FMU fits into a place.

    Attributes
    ----------
    variables : dict of str to str
        Our names and those proposed for them, where they differ.
    candidates : dict of str to list of str
        Inputs and outputs for which nothing is proposed, and what could be meant.
    unused : list of str
        Inputs and parameters of ours for which there is nothing, or nothing that follows from names and
        units.
    unmapped : list of str
        Parameters of the FMU that nothing of ours is mapped to.
    faults : list of str
        What keeps it from its place with that map.
    """

    variables: dict[str, str]
    candidates: dict[str, list[str]]
    unused: list[str]
    unmapped: list[str]
    faults: list[str]


def show(
    arguments: Sequence[str], built: Callable[[Sequence[str]], Mapping[str, Path]], console: Console
) -> bool:
    """Show a place, a file, or how a file fits into a place; return whether it does not fit.

    Parameters
    ----------
    arguments : sequence of str
        A place, a file, or both in any order.
    built : callable
        Builds FMUs of ours by the names of their models.
    console : Console
        Where it is printed.

    Raises
    ------
    InputError
        If there is no such place or file, or the file cannot be read.
    """
    files = [name for name in arguments if name not in _places() and _is_file(name)]
    names = [name for name in arguments if name not in files]
    if len(files) > 1 or len(names) > 1 or not arguments:
        raise InputError(f"{' '.join(arguments)}: expected a place of the loop, an FMU, or one of each")
    for name in names:
        if name not in _places():
            raise InputError(
                f"no place {quote(name)} in the loop{closest_match(name, _places())}, and no such file"
            )
    place = _place(names[0], built) if names else None
    document: dict[str, Any] = {"schema": SCHEMA}
    if place:
        document["place"] = {"model": names[0], "variables": [asdict(need) for need in place.needs]}
    if files:
        path = Path(files[0])
        description, faults = describe(path, validate=False)
        document["file"] = _file(path, description, faults)
    match = _match(place, path, not faults) if place and files else None
    if match:
        document["match"] = {("own" if k == "unmapped" else k): v for k, v in asdict(match).items()}
    console.print_json(json.dumps(document, indent=1, allow_nan=False))
    if place and not match:
        _print_place(place, console)
    if files and not match:
        _print_file(document["file"], console)
    if place and match:
        _print_match(place, path, match, bool(faults), console)
    return bool(match and (match.faults or match.candidates))


def _is_file(name: str) -> bool:
    return name.lower().endswith(".fmu") or Path(name).is_file()


def _places() -> dict[str, tuple[Run, Component]]:
    runs = [spacecraft.reference_run for spacecraft in reversed(registered().values())]
    return {c.model: (run, c) for run in runs for c in model_of(run).components(run)}


def _place(model: str, built: Callable[[Sequence[str]], Mapping[str, Path]]) -> Place:
    run, component = _places()[model]
    spacecraft = model_of(run)
    parameters = spacecraft.parameters(run)[model]
    ours = read(component, built([model])[model], parameters, None)

    def need(name: str, causality: str, default: float | None, *, optional: bool = False) -> Need:
        variable = ours.variables.get(name)
        text = (variable.description or "") if variable else ""
        value = None if default is None else default + 0.0  # no negative zero
        return Need(name, causality, spacecraft.units.get(name, "1"), value, text, optional)

    def start(name: str) -> float:
        return float(str(ours.variables[name].start or 0).split()[0])

    optional_inputs = [name for name in ours.candidates("input") if name not in component.inputs]
    needs = (
        *(need(name, "input", start(name)) for name in component.inputs),
        *(need(name, "input", start(name), optional=True) for name in optional_inputs),
        *(need(name, "output", None) for name in component.outputs),
        *(need(name, "parameter", value) for name, value in parameters.items()),
    )
    return Place(run, component, ours, needs)


def _file(path: Path, description: Any, faults: Sequence[str]) -> dict[str, Any]:
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    platforms = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") > 1})
    return {
        "path": str(path),
        "fmi": description.fmiVersion,
        "model": description.modelName,
        "tool": description.generationTool,
        "co_simulation": description.coSimulation is not None,
        "model_exchange": description.modelExchange is not None,
        "platforms": platforms,
        "sources": bool(description.buildConfigurations),
        "variables": [_variable(v) for v in description.modelVariables],
        "faults": list(_faults(path, description, faults)),
    }


def _variable(variable: Any) -> dict[str, Any]:
    declared = variable.declaredType
    return {
        "name": variable.name,
        "causality": variable.causality,
        "variability": variable.variability,
        "type": variable.type,
        "unit": variable.unit or (declared.unit if declared else None),
        "start": variable.start,
        "items": [item.name for item in declared.items] if declared else [],
        "shape": list(variable.shape or ()),
        "description": variable.description,
    }


def _faults(path: Path, description: Any, faults: Sequence[str]) -> Iterator[str]:
    """Say what keeps an FMU from every place, and what its user has to accept."""
    if description.fmiVersion[:2] not in ("2.", "3."):
        yield f"is FMI {line(description.fmiVersion)}; expected 2.0 or 3.0"
        return
    if faults:
        yield f"{nonconformity(faults)}; validate = false accepts that"
    if description.coSimulation is None:
        yield "is not for co-simulation"
        return
    try:
        compilation.check_platform(path, description, path)
    except InputError as error:
        yield str(error).removeprefix(f"{path}: ")


def _match(place: Place, path: Path, valid: bool) -> Match:
    """Propose a map of names, and see what is wrong with it."""
    mine = Replacement(place.component.model, path, validate=valid)
    units = model_of(place.run).units
    settings = model_of(place.run).parameters(place.run)[place.component.model]
    theirs = read(place.component, path, settings, mine)
    needs = [need for need in place.needs if not need.optional]
    found: dict[str, str] = {n.name: n.name for n in needs if n.name in theirs.candidates(n.causality)}
    for need in needs:
        fitting = [c for c in _fitting(theirs, need, units) if c not in found.values()]
        similar = difflib.get_close_matches(need.name, fitting, 1, _SIMILAR)
        if need.name not in found and similar:
            found[need.name] = similar[0]
    candidates, unused = dict[str, list[str]](), list[str]()
    for need in needs:
        if need.name in found:
            continue
        fitting = [c for c in _fitting(theirs, need, units) if c not in found.values()]
        rivals = [
            n for n in needs if (n.causality, n.unit) == (need.causality, need.unit) and n.name not in found
        ]
        if len(fitting) == len(rivals) == 1:
            found[need.name] = fitting[0]
        elif need.causality == "output" or (need.causality == "input" and fitting):
            candidates[need.name] = fitting
        else:
            unused.append(need.name)
    variables = {ours: name for ours, name in found.items() if ours != name}
    open_inputs = [name for name in candidates if name in place.component.inputs]
    declined = tuple(dict.fromkeys([*unused, *open_inputs]))
    chosen = replace(mine, variables=variables, unused=declined)
    inputs = {v: s for v, s in place.component.inputs.items() if v not in declined}
    outputs = tuple(name for name in place.component.outputs if name not in candidates)
    seated = read(replace(place.component, inputs=inputs, outputs=outputs), path, settings, chosen)
    faults = [str(fault) for fault in compatibility.problems(seated, units, settings, place.run.h)]
    unmapped = [name for name in theirs.candidates("parameter") if name not in found.values()]
    return Match(variables, candidates, unused, unmapped, faults)


def _fitting(theirs: Interface, need: Need, units: Mapping[str, str]) -> Iterator[str]:
    """Yield the variables of the right causality, type and unit."""
    for name in theirs.candidates(need.causality):
        mapped = Replacement(theirs.model, theirs.archive, {need.name: name})
        seated = replace(theirs, replacement=mapped)
        try:
            compatibility.check_variable(seated, need.name, need.causality)
            compatibility.check_unit(seated, need.name, units[need.name])
        except InputError:
            continue
        yield name


def _print_place(place: Place, console: Console) -> None:
    spacecraft = model_of(place.run)
    console.print_line(f"{place.component.model}: a place in the loop ({spacecraft.name})\n")
    rows = [
        (
            f"{n.causality}{' (optional)' if n.optional else ''}",
            n.name,
            n.unit,
            "" if n.default is None else f"{n.default:.6g}",
            line(n.description),
        )
        for n in place.needs
    ]
    _print(Table(("", "name", "unit", "default", "description"), tuple(rows)), console)
    if any(n.optional for n in place.needs):
        console.print_line("\nOptional inputs are fed only by campaigns that ask for them (docs/own-fmu.md).")


def _print_file(file: Mapping[str, Any], console: Console) -> None:
    kinds = [k for k, has in (("co-simulation", file["co_simulation"]),
                              ("model exchange", file["model_exchange"])) if has]  # fmt: skip
    console.print_line(
        f"{file['path']}: {line(file['model'])}, FMI {line(file['fmi'])}, {' and '.join(kinds)}"
    )
    console.print_line(f"tool: {line(file['tool'] or 'not stated')}")
    sources = " and sources" if file["sources"] else ""
    console.print_line(f"platforms: {', '.join(file['platforms']) or 'none'}{sources}\n")
    shown = [v for v in file["variables"] if v["causality"] in _CAUSALITIES]
    rows = [
        (
            v["causality"],
            line(v["name"] + (f"[{','.join(map(str, v['shape']))}]" if v["shape"] else "")),
            v["type"] + (f" ({', '.join(map(str, v['items']))})" if v["items"] else ""),
            line(v["unit"] or ""),
            line(v["start"] if v["start"] is not None else ""),
            line(v["description"] or ""),
        )
        for v in sorted(shown, key=lambda v: _CAUSALITIES.index(v["causality"]))
    ]
    _print(Table(("", "name", "type", "unit", "start", "description"), tuple(rows)), console)
    if n_local := len(file["variables"]) - len(shown):
        console.print_line(f"\nand {n_local} local variables; --json lists them")
    for fault in file["faults"]:
        console.print_line(f"\nnot usable as it is: {fault}")


def _print_match(place: Place, path: Path, match: Match, faulty: bool, console: Console) -> None:
    rows = []
    for need in place.needs:
        if need.optional:
            continue
        theirs = match.variables.get(need.name, need.name)
        if need.name in match.candidates:
            theirs = (
                f"one of {', '.join(match.candidates[need.name])}"
                if match.candidates[need.name]
                else "missing"
            )
        elif need.name in match.unused:
            theirs = "none, unused"
        rows.append((need.causality, need.name, need.unit, theirs))
    console.print_line(f"{path} in the place of {place.component.model}\n")
    _print(Table(("", "ours", "unit", path.name), tuple(rows)), console)
    console.print_line(f"\n[fmus.{place.component.model}]\npath = {json.dumps(str(path))}")
    mapped = ", ".join(f"{_key(ours)} = {json.dumps(name)}" for ours, name in match.variables.items())
    console.print_line(f"variables = {{ {mapped} }}" if mapped else "variables = {}")
    for name, choices in match.candidates.items():
        console.print_line(f"# {name} = {' or '.join(map(quote, choices)) or '?'}: to be added to variables")
    console.print_line(f"unused = {json.dumps(match.unused)}")
    if match.unmapped:
        listed = ", ".join(map(quote, match.unmapped[:MAX_LISTED]))
        console.print_line(f"# its own parameters, for variables or values: {listed}")
    if faulty:
        console.print_line("validate = false")
    for fault in match.faults:
        console.print_line(f"\ndoes not fit: {fault}")


def _key(name: str) -> str:
    return name if name.replace("_", "").isalnum() and name.isascii() else json.dumps(name)


def _print(lines: Table, console: Console) -> None:
    for text in lines.aligned():
        console.print_line(text)
