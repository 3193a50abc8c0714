"""Which parameters of which FMUs are sought, and what they start from."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fit.errors import quote
from fit.files import closest_match
from lpfcosim.campaign import Campaign, Sought
from lpfcosim.cosim import Interface
from lpfcosim.errors import InputError
from lpfcosim.spacecraft import LONGEST_DELAY, H, Run
from lpfcosim.worlds import world_of

#: What the fit has under the same name, and what follows from others: C_j = lambda_j tau_j.
SHARED_NAMES = (
    *("lambda_1", "lambda_2", "omega2_1_0", "omega2_2_0"),
    *("alpha_x_1", "alpha_phi_1", "alpha_x_2", "alpha_phi_2", "delta_ifo"),
)
DELAYS = {"C_1": ("lambda_1", "tau_1"), "C_2": ("lambda_2", "tau_2")}
_HELD = ("h",)  # the step of the loop is no parameter of it
LIKE = 10.0  # times a gain of the campaign, or as little: beyond, it is another actuation
_ANY = (-math.inf, math.inf)


@dataclass(frozen=True)
class Target:
    """A parameter of an FMU.

    Attributes
    ----------
    name : str
        As results have it: that of the fit where it has the same, else ``Model.parameter``.
    model, variable : str
        The FMU in its place, and its own name of the parameter.
    given : float
        Its value where nothing else is said, in the unit of the FMU.
    unit : str
        Its unit.
    sought : Sought
        What the campaign says of it.
    possible : tuple of float
        Between which values it can be, if the campaign does not tell bounds.
    """

    name: str
    model: str
    variable: str
    given: float
    unit: str
    sought: Sought
    possible: tuple[float, float] = _ANY


def targets(plan: Campaign, run: Run, found: Sequence[Interface]) -> tuple[Target, ...]:
    """Return what a campaign seeks; without a table ``[identify]``, all that the fit estimates too.

    Raises
    ------
    InputError
        If there is no such parameter, or it cannot be set.
    """
    by_model = {i.model: i for i in found}
    values = world_of(run).parameters(run)
    of_fit = (*SHARED_NAMES[:2], *DELAYS, *SHARED_NAMES[2:])
    sought = dict(plan.identify) or {name: Sought() for name in of_fit}
    resolved = []
    for key, entry in sought.items():
        where = f"identify.{key}"
        model, dot, name = key.partition(".")
        if not dot:
            model, name = _place(key, by_model, where), DELAYS[key][1] if key in DELAYS else key
        if model not in by_model:
            raise InputError(f"{where}: the loop has no {quote(model)}{closest_match(model, by_model)}")
        target = _target(key, name, by_model[model], values[model], entry)
        given = target.given * _gain(key, run) if key in DELAYS else target.given
        resolved.append(replace(target, given=given, possible=_possible(target, run)))
    names = [target.name for target in resolved]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"identify: {name} is sought twice, expected once")
    at = [(target.model, target.variable) for target in resolved]
    for target in resolved:
        if at.count((target.model, target.variable)) > 1:
            raise InputError(f"identify: {target.model}.{target.variable} is sought under two names")
    return tuple(resolved)


def _possible(target: Target, run: Run) -> tuple[float, float]:
    """Return between which values a gain or a delay can be; the hold of a command takes half a sample."""
    if target.name in ("lambda_1", "lambda_2") and target.given > 0:
        return target.given / LIKE, target.given * LIKE
    if target.name in DELAYS:
        gain = _gain(target.name, run)
        return H / 2 * gain, LONGEST_DELAY * gain
    return (H / 2, LONGEST_DELAY) if target.name.endswith(("Plant.tau_1", "Plant.tau_2")) else _ANY


def _gain(delay: str, run: Run) -> float:
    """Return the gain that makes a delay its coefficient."""
    gain: float = getattr(run.truth, DELAYS[delay][0])
    return gain


def held(run: Run, found: Sequence[Interface], sought: Sequence[Target]) -> dict[str, float]:
    """Return what the loop has of the parameters of the fit where they are not `sought`; no delta_ifo."""
    by_model = {i.model: i for i in found}
    values = world_of(run).parameters(run)
    known: dict[str, float] = {}
    for name in (*SHARED_NAMES[:-1], *(tau for _, tau in DELAYS.values())):
        with contextlib.suppress(InputError):  # no FMU takes it
            model = _place(name, by_model, "identify")
            target = _target(name, name, by_model[model], values[model], Sought())
            if (model, target.variable) not in [(t.model, t.variable) for t in sought]:
                known[name] = target.given
    for name, (gain, tau) in DELAYS.items():
        delay = known.pop(tau, None)
        if delay is not None and gain in known:
            known[name] = known[gain] * delay
    return known


def _place(name: str, by_model: Mapping[str, Interface], where: str) -> str:
    """Return the model that has a parameter of the fit."""
    wanted = DELAYS[name][1] if name in DELAYS else name
    if wanted in (*SHARED_NAMES, "tau_1", "tau_2"):
        for model, interface in by_model.items():
            if wanted in interface.settings and interface.takes(wanted):
                return model
        raise InputError(f"{where}: no FMU of the loop takes {wanted}")
    known = [*SHARED_NAMES, *DELAYS]
    raise InputError(
        f"{where}: expected a table of a model, or a parameter of the fit{closest_match(name, known)}"
    )


def _target(key: str, name: str, interface: Interface, values: Mapping[str, float], sought: Sought) -> Target:
    mapped = interface.replacement.variables if interface.replacement else {}
    name = {theirs: known for known, theirs in mapped.items()}.get(name, name)
    ours = name in interface.settings and interface.takes(name)
    variable = interface.name(name) if ours else name
    where = f"identify.{key}: {interface.named}"
    parameters = interface.candidates("parameter")
    try:
        record = interface.variable(variable)
    except InputError:
        raise InputError(
            f"{where}: has no parameter {quote(variable)}{closest_match(variable, parameters)}"
        ) from None
    if record.causality != "parameter" or record.variability == "constant" or name in _HELD:
        kind = "held by the loop" if name in _HELD else f"of causality '{record.causality}'"
        raise InputError(f"{where}: {quote(variable)} is {kind}; expected a parameter that can be set")
    if record.type not in ("Real", "Float64", "Float32"):
        raise InputError(f"{where}: {quote(variable)} is of type {record.type}; expected a real number")
    _, element = interface.place(variable)
    given = values[name] if ours else float(interface.start_values(record)[element])
    shared = ours and name in SHARED_NAMES
    told = key if key in DELAYS else name if shared else f"{interface.model}.{name}"
    unit = "s" if key in DELAYS else (interface.stated_unit(variable) or "1").replace(".", " ")
    return Target(told, interface.model, variable, given, unit, sought)


def settings(
    of: Sequence[Target], theta: Mapping[str, float], gains: Mapping[str, float]
) -> dict[str, dict[str, float]]:
    """Return the parameters of a trial by model.

    Parameters
    ----------
    of : sequence of Target
        What is sought.
    theta : mapping of str to float
        Its values by name.
    gains : mapping of str to float
        lambda_1 and lambda_2 where they are not sought.

    Raises
    ------
    InputError
        If a gain is zero, and a delay is to follow from it.
    """
    found: dict[str, dict[str, float]] = {}
    for target in of:
        value = theta[target.name]
        if target.name in DELAYS:
            name = DELAYS[target.name][0]
            gain = theta[name] if name in theta else gains[name]
            if gain == 0:
                raise InputError(f"{target.name} tells no delay where {name} is 0")
            value /= gain
        found.setdefault(target.model, {})[target.variable] = value
    return found
