"""Which parameters of which FMUs are sought, and what they start from."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fit.errors import quote
from fit.files import closest_match
from lpfcosim.campaign import Campaign, IdentifyTable
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
#: What a campaign seeks by default; fixed values are in this order, gains before their delays.
OF_FIT = (*SHARED_NAMES[:2], *DELAYS, *SHARED_NAMES[2:])
GAIN_RANGE = 10.0  # times a gain of the campaign, or as little: beyond, it is another actuation


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
    request : IdentifyTable
        What the campaign says of it.
    limits : tuple of float
        Between which values it can be, if the campaign gives no bounds.
    """

    name: str
    model: str
    variable: str
    default_value: float
    unit: str
    request: IdentifyTable
    limits: tuple[float, float] = (-math.inf, math.inf)

    @property
    def place(self) -> str:
        """Model and variable."""
        return f"{self.model}.{self.variable}"


def targets(plan: Campaign, run: Run, interfaces: Sequence[Interface]) -> tuple[Target, ...]:
    """Return what a campaign seeks; without a table ``[identify]``, all that the fit estimates too.

    Raises
    ------
    InputError
        If there is no such parameter, or it cannot be set.
    """
    requests = dict(plan.identify) or dict.fromkeys(OF_FIT, IdentifyTable())
    resolved = tuple(_target(key, entry, run, interfaces) for key, entry in requests.items())
    places = [target.place for target in resolved]
    for place in places:
        if places.count(place) > 1:
            raise InputError(f"identify: {place} is listed twice, expected once")
    return resolved


def fixed_values(
    run: Run, interfaces: Sequence[Interface], free_targets: Sequence[Target]
) -> dict[str, float]:
    """Return the parameters of the fit that the loop fixes, by name, without delta_ifo."""
    free = {target.place for target in free_targets}
    known: dict[str, float] = {}
    for name in OF_FIT[:-1]:
        with contextlib.suppress(InputError):  # no FMU takes it
            target = _target(name, IdentifyTable(), run, interfaces)
            if target.place not in free and (name not in DELAYS or DELAYS[name][0] in known):
                known[name] = target.default_value
    return known


def _limits(name: str, value: float, gain: float) -> tuple[float, float]:
    """Return between which values a gain or a delay can be; the hold of a command takes half a sample."""
    if name in ("lambda_1", "lambda_2") and value > 0:
        return value / GAIN_RANGE, value * GAIN_RANGE
    if name in DELAYS:
        return H / 2 * gain, LONGEST_DELAY * gain
    return (0, LONGEST_DELAY) if name in ("Plant.tau_1", "Plant.tau_2") else (-math.inf, math.inf)


def _place(name: str, by_model: Mapping[str, Interface], location: str) -> str:
    """Return the model that has a parameter of the fit."""
    variable = DELAYS[name][1] if name in DELAYS else name
    for model, interface in by_model.items():
        if variable in interface.settings and interface.takes(variable):
            return model
    raise InputError(f"{location}: no FMU of the loop takes it{closest_match(name, OF_FIT)}")


def _target(key: str, request: IdentifyTable, run: Run, interfaces: Sequence[Interface]) -> Target:
    by_model = {i.model: i for i in interfaces}
    model, dot, name = key.partition(".")
    if not dot:
        model = _place(key, by_model, f"identify.{key}")
        name = DELAYS[key][1] if key in DELAYS else key
    if model not in by_model:
        raise InputError(f"identify.{key}: the loop has no {quote(model)}{closest_match(model, by_model)}")
    interface = by_model[model]
    mapped = interface.replacement.variables if interface.replacement else {}
    name = {fmu_name: known for known, fmu_name in mapped.items()}.get(name, name)
    ours = name in interface.settings and interface.takes(name)
    variable = interface.name(name) if ours else name
    location = f"identify.{key}: {interface.named}"
    parameters = interface.candidates("parameter")
    record = interface.variable(variable) if variable in parameters and name != "h" else None
    kinds = ("Real", "Float64", "Float32")
    if record is None or record.variability == "constant" or record.type not in kinds:
        hint = closest_match(variable, parameters)
        raise InputError(f"{location}: has no real parameter {quote(variable)} that can be set{hint}")
    values = model_of(run).parameters(run)[model]
    value = values[name] if ours else float(interface.start(variable))
    result_name = key if key in DELAYS else name if ours and name in SHARED_NAMES else f"{model}.{name}"
    unit = "s" if key in DELAYS else (interface.stated_unit(variable) or "1").replace(".", " ")
    gain = run.truth[DELAYS[key][0]] if key in DELAYS else 1.0
    value = (value + H / 2) * gain if key in DELAYS else value
    return Target(result_name, model, variable, value, unit, request, _limits(result_name, value, gain))


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
