"""Do the FMUs fit their places in the loop? Said before anything is simulated."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from fit import units
from fit.errors import quote
from lpfcosim.cosim import compilation
from lpfcosim.cosim.interface import BASE_UNITS, Interface, nonconformity, read
from lpfcosim.cosim.variables import REALS, MissingVariableError, known, size, stage
from lpfcosim.errors import InputError
from lpfcosim.messages import grouped, line
from lpfcosim.models import model_of
from lpfcosim.network import check_feedthrough
from lpfcosim.spacecraft import Run


def read_interfaces(run: Run, fmus: Mapping[str, Path]) -> list[Interface]:
    """Read the descriptions of the FMUs of a run, in the order of their steps, and check that they fit.

    This is all that can be known of FMUs in their places before their code is loaded, which it never is here:
    whoever wants to say whether a campaign can run calls this, and prints `warnings` of what it returns. To
    list every fault of one FMU instead of raising the first, see `problems`.

    Parameters
    ----------
    run : Run
        Gives the parameters, the step size and what is put in the place of ours.
    fmus : mapping of str to Path
        The FMU of each component; of those of the user, the file itself or a copy. Of a component without
        one, only its interface is read.

    Raises
    ------
    InputError
        If an FMU cannot be read, is not for co-simulation, lacks a variable, has it with another causality,
        type or unit, takes no such value, wants other steps, is neither for this platform nor comes with
        sources, or closes an algebraic loop. The message names table and file of the user.
    """
    replaced = {r.model: r for r in run.replacements}
    interfaces = []
    spacecraft = model_of(run)
    settings = spacecraft.parameters(run)
    direct: dict[str, Mapping[str, Iterable[str]]] = {}
    for component in spacecraft.components(run):
        if component.model not in fmus:
            direct[component.model] = component.direct
            continue
        replacement = replaced.get(component.model)
        values = settings[component.model]
        try:
            interface = read(component, fmus[component.model], values, replacement)
            for problem in problems(interface, spacecraft.units, values, run.h):
                raise problem
        except InputError as error:
            place = f"fmus.{component.model}: " if replacement else ""
            raise InputError(f"{place}{error}") from None
        interfaces.append(interface)
        direct[component.model] = interface.direct
    check_feedthrough(spacecraft.components(run), direct)
    return interfaces


def read_interfaces_of_runs(runs: Sequence[Run], fmus: Mapping[str, Path]) -> list[Interface]:
    """Check that the FMUs of a campaign fit their places in every run, as `read_interfaces` does for one.

    Runs may differ in parameter values, which an FMU may refuse.

    Parameters
    ----------
    runs : sequence of Run
        All of the campaign.
    fmus : mapping of str to Path
        As of `read_interfaces`.

    Returns
    -------
    list of Interface
        Of the first run.

    Raises
    ------
    InputError
        As `read_interfaces`; with the names of the runs, unless it is the same for all.
    """
    interfaces: list[list[Interface]] = []
    refused: list[tuple[str, str]] = []
    for run in runs:
        try:
            interfaces.append(read_interfaces(run, fmus))
        except InputError as error:
            refused.append((run.name, str(error)))
    causes = {cause for _, cause in refused}
    if len(refused) == len(runs) and len(causes) == 1:
        raise InputError(causes.pop())
    if refused:
        raise InputError("; ".join(grouped(refused)))
    return interfaces[0]


def warnings(interfaces: Iterable[Interface]) -> list[str]:
    """Return what users should know of their FMUs that does not keep them from running, a sentence each."""
    sentences = []
    for interface in interfaces:
        place = f"fmus.{interface.model}: {interface.named}"
        if interface.faults:
            sentences.append(
                f"{place}: {nonconformity(interface.faults)}; accepted because of validate = false"
            )
        if interface.replacement and not compilation.has_binary(interface.archive, interface.description):
            sentences.append(f"{place}: has no binary for this platform, its sources are compiled")
    return sentences


def ignored_names(interfaces: Iterable[Interface]) -> dict[str, tuple[str, ...]]:
    """Of every replaced component, inputs and parameters of ours that the FMU in its place does not take."""
    return {i.model: i.ignored for i in interfaces if i.replacement}


def problems(
    interface: Interface, unit_of: Mapping[str, str], values: Mapping[str, float], h: float
) -> Iterator[InputError]:
    """Yield what keeps an FMU from its place, one error each; none is raised.

    Parameters
    ----------
    interface : Interface
        The FMU in its place.
    unit_of : mapping of str to str
        Unit of each variable of the place.
    values : mapping of str to float
        Parameters of the place, SI.
    h : float
        Step of the loop [s].
    """
    parameters = [name for name in interface.settings if interface.takes(name)]
    checks: list[Callable[[], object]] = []
    for names, causality in (
        (interface.component.inputs, "input"),
        (interface.component.outputs, "output"),
        (parameters, "parameter"),
    ):
        for name in names:
            checks.append(partial(check_variable, interface, name, causality))
            if interface.replacement:  # ours have the units of the place, from the same Modelica
                checks.append(partial(check_unit, interface, name, unit_of[name]))
    user_values = interface.replacement.values if interface.replacement else {}
    checks += [partial(_check_settable, interface, name) for name in user_values]
    missing = False
    for check in checks:
        try:
            check()
        except InputError as error:
            missing = True
            yield error
    general: list[Callable[[], object]] = [
        partial(_check_token, interface),
        partial(_check_step, interface, h),
        partial(compilation.check_platform, interface.archive, interface.description, interface.named),
    ]
    if not missing:
        general = [
            partial(_check_once, interface, parameters),
            partial(_check_values, interface, values),
            *general,
        ]
    for check in general:
        try:
            check()
        except InputError as error:
            yield error


def _check_once(interface: Interface, parameters: Iterable[str]) -> None:
    """Refuse a variable that would be set from two sides, be it under two names."""
    user_values = interface.replacement.values if interface.replacement else ()
    set_by: dict[tuple[tuple[str, int], int], str] = {}
    for name in (*interface.inputs, *map(interface.name, parameters), *user_values):
        place = interface.place(name)
        if set_by.get(place) == name:
            raise InputError(
                f"{interface.named}: '{name}' is set by the loop and under values; expected once"
            )
        if place in set_by:
            name_set = set_by[place]
            raise InputError(f"{interface.named}: '{name_set}' and '{name}' are one variable; expected two")
        set_by[place] = name


def _check_values(interface: Interface, values: Mapping[str, float]) -> None:
    """Refuse values that are not of the type of their variable, and start values that the loop cannot send.

    Inputs and arrays are sent as a whole, with the start values of the elements that nothing else sets.
    """
    for name in interface.parameters(values):
        variable = interface.variable(name)
        if size(variable) != 1:
            interface.start_values(variable)
    for name in (*interface.inputs, *interface.outputs):
        interface.start_values(interface.variable(name))


def check_variable(interface: Interface, ours: str, causality: str) -> None:
    """Refuse a variable for one of ours that is missing, or of another causality or type."""
    name = interface.name(ours)
    try:
        variable = interface.variable(name)
    except InputError as error:
        purpose = f" as its {causality} for {ours}" if interface.replacement else ""
        missing = isinstance(error, MissingVariableError)
        hint = known(interface.candidates(causality), name) if missing else ""
        raise InputError(f"{error}{purpose}{hint}") from None
    place = f"{interface.named}: variable '{name}'"
    if variable.causality != causality or variable.variability == "constant":
        constant = variable.variability == "constant"
        attribute = "constant" if constant else f"of causality '{line(variable.causality)}'"
        raise InputError(f"{place} is {attribute}; expected causality '{causality}' for {ours}")
    kind = "Real" if interface.version.startswith("2") else "Float64"
    if variable.type not in REALS:
        raise InputError(f"{place} is of type {line(variable.type)}; expected {kind} for {ours}")


def _check_settable(interface: Interface, name: str) -> None:
    """Refuse a variable under ``values`` that is missing or cannot be set before the first step."""
    every = {n: v for n, v in interface.variables.items() if stage(v)}
    try:
        variable = interface.variable(name)
    except MissingVariableError:
        raise InputError(
            f"{interface.named}: has no parameter {quote(name)}, which values names{known(every, name)}"
        ) from None
    if stage(variable) is None:
        kinds = line(
            f"'{variable.causality}', variability '{variable.variability}', initial '{variable.initial}'"
        )
        raise InputError(
            f"{interface.named}: variable '{name}' of values cannot be set: it is of causality {kinds}; "
            "expected a parameter, an input or a variable with a start value"
        )


def check_unit(interface: Interface, ours: str, unit_expected: str) -> None:
    """Refuse a variable in another unit than ours; one that states none is taken to be in ours."""
    name = interface.name(ours)
    unit = interface.stated_unit(name)
    if unit is None:
        return
    base = interface.units.get(unit)
    place = f"{interface.named}: variable '{name}' is in {line(unit)}"
    if base is None:
        if not units.same_unit(unit, unit_expected):
            raise InputError(
                f"{place}, of which it does not give the base units; expected {unit_expected}, for {ours}"
            )
        return
    exponents = {n: int(p) for n, p in base.items() if n in BASE_UNITS}
    factor, offset = float(base.get("factor", 1)), float(base.get("offset", 0))
    exponents_expected, _, _ = units.in_base_units(unit_expected)
    if exponents != exponents_expected or abs(factor - 1) > 1e-12 or offset:
        meaning = (
            f"{factor:g} {unit_expected}" if exponents == exponents_expected else _spelled(exponents, factor)
        )
        also = f" with an offset of {offset:g}" if offset else ""
        raise InputError(f"{place}, by which it means {meaning}{also}; expected {unit_expected}, for {ours}")


def _spelled(exponents: Mapping[str, int], factor: float) -> str:
    product = ".".join(f"{base}{power if power != 1 else ''}" for base, power in exponents.items()) or "1"
    return product if factor == 1 else f"{factor:g} {product}"


def _check_token(interface: Interface) -> None:
    """Refuse a description without the token by which an FMU recognises it."""
    if not interface.description.instantiationToken:
        token = "guid" if interface.version.startswith("2") else "instantiationToken"
        raise InputError(f"{interface.named}: its modelDescription.xml has no {token}; expected one")


def _check_step(interface: Interface, h: float) -> None:
    """Refuse an FMU whose own step does not divide ours, or that takes no other than the one it names."""
    simulation, experiment = interface.description.coSimulation, interface.description.defaultExperiment
    needed = simulation.fixedInternalStepSize
    if needed is None and not simulation.canHandleVariableCommunicationStepSize and experiment is not None:
        needed = experiment.stepSize
    if needed is None:
        return
    try:
        step = float(needed)
    except ValueError:  # in an archive that is not valid
        step = math.nan
    steps = h / step if step > h * 1e-9 else math.nan
    if not steps >= 0.5 or abs(steps - round(steps)) > 1e-6:
        raise InputError(
            f"{interface.named}: steps by {step:g} s; expected a step that divides that of the loop, {h:g} s"
        )
