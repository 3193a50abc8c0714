"""Which parameters of which FMUs are sought, and what they start from."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fit.errors import quote
from fit.files import closest_match
from lpfcosim.campaign import Campaign, ParameterSpec
from lpfcosim.cosim import Interface
from lpfcosim.errors import InputError
from lpfcosim.models import model_of
from lpfcosim.spacecraft import LONGEST_DELAY, H, Run

#: What the fit has under the same name, and what follows from others: C_j = lambda_j (tau_j + h/2). The
#: parameter tau_j of the FMU is the transport delay; the hold of a command adds half a sample.
SHARED_NAMES = (
    *("lambda_1", "lambda_2", "omega2_1_0", "omega2_2_0"),
    *("alpha_x_1", "alpha_phi_1", "alpha_x_2", "alpha_phi_2", "delta_ifo"),
)
DELAYS = {"C_1": ("lambda_1", "tau_1"), "C_2": ("lambda_2", "tau_2")}
_FIXED = ("h",)  # the step of the loop is no parameter of it
GAIN_RANGE = 10.0  # times a gain of the campaign, or as little: beyond, it is another actuation
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
    default_value : float
        Its value where nothing else is said, in the unit of the FMU.
    unit : str
        Its unit.
    request : ParameterSpec
        What the campaign says of it.
    limits : tuple of float
        Between which values it can be, if the campaign gives no bounds.
    """

    name: str
    model: str
    variable: str
    default_value: float
    unit: str
    request: ParameterSpec
    limits: tuple[float, float] = _ANY


def targets(plan: Campaign, run: Run, interfaces: Sequence[Interface]) -> tuple[Target, ...]:
    """Return what a campaign seeks; without a table ``[identify]``, all that the fit estimates too.

    Raises
    ------
    InputError
        If there is no such parameter, or it cannot be set.
    """
    by_model = {i.model: i for i in interfaces}
    values = model_of(run).parameters(run)
    of_fit = (*SHARED_NAMES[:2], *DELAYS, *SHARED_NAMES[2:])
    requests = dict(plan.identify) or {name: ParameterSpec() for name in of_fit}
    resolved = []
    for key, entry in requests.items():
        location = f"identify.{key}"
        model, dot, name = key.partition(".")
        if not dot:
            model, name = _place(key, by_model, location), DELAYS[key][1] if key in DELAYS else key
        if model not in by_model:
            raise InputError(f"{location}: the loop has no {quote(model)}{closest_match(model, by_model)}")
        target = _target(key, name, by_model[model], values[model], entry)
        default_value = target.default_value
        if key in DELAYS:
            default_value = (default_value + H / 2) * _gain(key, run)
        resolved.append(replace(target, default_value=default_value, limits=_limits(target, run)))
    names = [target.name for target in resolved]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"identify: {name} is listed twice, expected once")
    places = [(target.model, target.variable) for target in resolved]
    for target in resolved:
        if places.count((target.model, target.variable)) > 1:
            raise InputError(f"identify: {target.model}.{target.variable} is listed under two names")
    return tuple(resolved)


def _limits(target: Target, run: Run) -> tuple[float, float]:
    """Return between which values a gain or a delay can be; the hold of a command takes half a sample."""
    if target.name in ("lambda_1", "lambda_2") and target.default_value > 0:
        return target.default_value / GAIN_RANGE, target.default_value * GAIN_RANGE
    if target.name in DELAYS:
        gain = _gain(target.name, run)
        return H / 2 * gain, LONGEST_DELAY * gain
    return (0, LONGEST_DELAY) if target.name.endswith(("Plant.tau_1", "Plant.tau_2")) else _ANY


def _gain(delay: str, run: Run) -> float:
    """Return the gain that makes a delay its coefficient."""
    gain: float = getattr(run.truth, DELAYS[delay][0])
    return gain


def fixed_values(
    run: Run, interfaces: Sequence[Interface], free_targets: Sequence[Target]
) -> dict[str, float]:
    """Return the parameters of the fit that the loop fixes, by name, without delta_ifo."""
    by_model = {i.model: i for i in interfaces}
    values = model_of(run).parameters(run)
    known: dict[str, float] = {}
    for name in (*SHARED_NAMES[:-1], *(tau for _, tau in DELAYS.values())):
        with contextlib.suppress(InputError):  # no FMU takes it
            model = _place(name, by_model, "identify")
            target = _target(name, name, by_model[model], values[model], ParameterSpec())
            if (model, target.variable) not in [(t.model, t.variable) for t in free_targets]:
                known[name] = target.default_value
    for name, (gain, tau) in DELAYS.items():
        delay = known.pop(tau, None)
        if delay is not None and gain in known:
            known[name] = known[gain] * (delay + H / 2)
    return known


def _place(name: str, by_model: Mapping[str, Interface], location: str) -> str:
    """Return the model that has a parameter of the fit."""
    variable = DELAYS[name][1] if name in DELAYS else name
    if variable in (*SHARED_NAMES, "tau_1", "tau_2"):
        for model, interface in by_model.items():
            if variable in interface.settings and interface.takes(variable):
                return model
        raise InputError(f"{location}: no FMU of the loop takes {variable}")
    known = [*SHARED_NAMES, *DELAYS]
    raise InputError(
        f"{location}: expected a table of a model, or a parameter of the fit{closest_match(name, known)}"
    )


def _target(
    key: str, name: str, interface: Interface, values: Mapping[str, float], request: ParameterSpec
) -> Target:
    mapped = interface.replacement.variables if interface.replacement else {}
    name = {fmu_name: known for known, fmu_name in mapped.items()}.get(name, name)
    ours = name in interface.settings and interface.takes(name)
    variable = interface.name(name) if ours else name
    location = f"identify.{key}: {interface.named}"
    parameters = interface.candidates("parameter")
    try:
        record = interface.variable(variable)
    except InputError:
        raise InputError(
            f"{location}: has no parameter {quote(variable)}{closest_match(variable, parameters)}"
        ) from None
    if record.causality != "parameter" or record.variability == "constant" or name in _FIXED:
        kind = "held by the loop" if name in _FIXED else f"of causality '{record.causality}'"
        raise InputError(f"{location}: {quote(variable)} is {kind}; expected a parameter that can be set")
    if record.type not in ("Real", "Float64", "Float32"):
        raise InputError(f"{location}: {quote(variable)} is of type {record.type}; expected a real number")
    _, element = interface.place(variable)
    default_value = values[name] if ours else float(interface.start_values(record)[element])
    shared = ours and name in SHARED_NAMES
    result_name = key if key in DELAYS else name if shared else f"{interface.model}.{name}"
    unit = "s" if key in DELAYS else (interface.stated_unit(variable) or "1").replace(".", " ")
    return Target(result_name, interface.model, variable, default_value, unit, request)


def settings(
    free_targets: Sequence[Target], theta: Mapping[str, float], gains: Mapping[str, float]
) -> dict[str, dict[str, float]]:
    """Return the parameters of a trial by model.

    Parameters
    ----------
    free_targets : sequence of Target
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
    values: dict[str, dict[str, float]] = {}
    for target in free_targets:
        value = theta[target.name]
        if target.name in DELAYS:
            name = DELAYS[target.name][0]
            gain = theta[name] if name in theta else gains[name]
            if gain == 0:
                raise InputError(f"{target.name} has no delay where {name} is 0")
            value = value / gain - H / 2
        values.setdefault(target.model, {})[target.variable] = value
    return values
