"""The parameters of an identification: their start, and the map to those of each experiment.

Those of the loop come first, then cross-talk, which is estimated along, then what departs in each experiment
where the fit lets gains or delays scatter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.fitting import constraints, random_effects
from fit.identification.loop import FreeParameter
from fit.model import Sharing, dynamics
from fit.parameters import Parameter
from fit.results import Results
from fit.settings import ParameterSettings, Settings
from fit.telemetry import Telemetry
from fit.whitening import Experiment

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointParameters:
    """The joint parameters.

    Attributes
    ----------
    parameters : tuple of Parameter
        The P parameters, with where the search begins.
    free : tuple of str
        Those of the loop.
    names : tuple of str
        The L parameters of the loop of an experiment, by the names that it knows.
    scales : tuple of ndarray, each of shape (L,)
        Their natural scales, and bounds.
    settings : mapping of str to ParameterSettings
        Constraints and bounds of joint parameters.
    random_effects : tuple of ScaleParameter
        The widths of departures.
    maps : tuple of ndarray, each of shape (K, P)
        By experiment, the map from the joint parameters to those of the loop and the measured ones.
    measured_names : tuple of tuple of str
        By experiment, its K - L parameters after those of the loop, see `MeasuredInputs`.
    dynamics : tuple of ndarray, each of shape (7,)
        By experiment, `dynamics.PARAMETERS` as the fit has them.
    """

    parameters: tuple[Parameter, ...]
    free: tuple[str, ...]
    names: tuple[str, ...]
    scales: tuple[Array, Array, Array]
    settings: Mapping[str, ParameterSettings]
    random_effects: tuple[random_effects.ScaleParameter, ...]
    maps: tuple[Array, ...]
    measured_names: tuple[tuple[str, ...], ...]
    dynamics: tuple[Array, ...]

    @property
    def start(self) -> Array:
        """Where the search begins, shape (P,)."""
        return np.array([p.value for p in self.parameters])

    def run_parameters(self, k: int, theta: Array) -> dict[str, float]:
        """Return the parameters of the loop in the k-th experiment by name; theta has the shape (P,)."""
        return dict(zip(self.names, (self.maps[k] @ theta).tolist(), strict=False))


def joint(
    experiments: Sequence[Experiment], free: Sequence[FreeParameter], settings: Settings, calibrated: Results
) -> JointParameters:
    """Join the parameters of experiments that are to be identified together.

    Parameters
    ----------
    experiments : sequence of Experiment
        The experiments.
    free : sequence of FreeParameter
        The parameters of the loop.
    settings : Settings
        Constraints, and over what cross-talk is shared.
    calibrated : Results
        Where the search begins, and what scatters.
    """
    runs = [e.sysid.telemetry for e in experiments]
    varying = [p.name for p in free if p.shared != "campaign"]
    departing = [name for name in calibrated.provenance.scatter or {} if name not in varying]
    measured = {name for e in experiments for name in e.parameters}
    coupled = [FreeParameter(n, shared=settings.shared[n]) for n in dynamics.CROSS_TALK if n in measured]
    of_loop = joint_parameters(free, runs)
    parameters = of_loop | joint_parameters(coupled, runs)
    stated = {name: s for name, s in settings.parameters.items() if name in parameters}
    limits = {name: _bounded(stated.get(name), *p.bounds) for name, (_, p) in parameters.items()}
    fitted = calibrated.joint.values if calibrated.joint else {}
    names = list(parameters)
    departures, widths = random_effects.parameters(departing, [e.name for e in experiments], len(names))
    maps, measured_names = [], []
    for n, e in enumerate(experiments):
        cross_talk = [p for p in coupled if p.name in e.parameters]
        rows = [[float(p.parameter(runs[n]).name == name) for name in names] for p in (*free, *cross_talk)]
        of_experiment = [p.name for p in free], [p.name for p in cross_talk]
        extended, extra = _with_departures(np.array(rows), *of_experiment, departing, n, len(experiments))
        maps.append(extended)
        measured_names.append(extra)
    return JointParameters(
        parameters=(
            *(replace(p, value=_start(p, f, limits[name], fitted)) for name, (p, f) in parameters.items()),
            *departures,
        ),
        free=tuple(of_loop),
        names=tuple(p.name for p in free),
        scales=(
            np.array([p.parameter(runs[0]).prior_sigma for p in free]),
            *np.array([p.bounds for p in free]).T,
        ),
        settings={n: s.model_copy(update={"value": None}) for n, s in limits.items() if s.record()},
        random_effects=tuple(widths),
        maps=tuple(maps),
        measured_names=tuple(measured_names),
        dynamics=tuple(_dynamics(run, fitted, settings) for run in runs),
    )


def joint_parameters(
    free: Sequence[FreeParameter], runs: Sequence[Telemetry]
) -> dict[str, tuple[Parameter, FreeParameter]]:
    """Return the parameters of a joint fit by name, each with what it came from."""
    by_epoch = sorted(runs, key=lambda run: run.alignment_epoch)
    parameters: dict[str, tuple[Parameter, FreeParameter]] = {}
    for p in free:
        for run in runs if p.shared == "experiment" else by_epoch:
            parameter = p.parameter(run)
            parameters.setdefault(parameter.name, (parameter, p))
    return parameters


def _start(
    parameter: Parameter, free: FreeParameter, limit: ParameterSettings, fitted: Mapping[str, float]
) -> float:
    """Return where the search starts: as the user states, at the estimate of the fit, or in flight."""
    value = parameter.value
    if free.start is None and limit.vary:
        value = fitted.get(parameter.name, value)
    return float(np.clip(value if limit.value is None else limit.value, *limit.limits))


def _bounded(stated: ParameterSettings | None, low: float, high: float) -> ParameterSettings:
    """Return what a user states of a parameter, within the bounds of the search where it states none."""
    setting = stated or ParameterSettings()
    if setting.expr or not setting.vary:
        return setting
    limits = {
        "min": low if setting.min is None and np.isfinite(low) else setting.min,
        "max": high if setting.max is None and np.isfinite(high) else setting.max,
    }
    return setting.model_copy(update=limits)


def check_constraints(
    experiments: Sequence[Experiment], free: Sequence[FreeParameter], calibrated: Results, settings: Settings
) -> None:
    """Refuse constraints of parameters that are neither identified nor were constrained in the fit.

    Raises
    ------
    InputError
        If there are any, or a tie cannot be followed.
    """
    names = joint_parameters(free, [e.sysid.telemetry for e in experiments])
    fitted = (calibrated.provenance.settings or {}).get("parameters", {})
    of_fit = fitted if isinstance(fitted, Mapping) else {}
    stated = {n: s for n, s in settings.parameters.items() if "." in n or of_fit.get(n) != s.record()}
    known = [*names, *(name for name in of_fit if "." not in name)]
    constraints.check(stated, known, "fit.parameters", has_fmus=True)


def _with_departures(
    own_map: Array,
    loop_names: Sequence[str],
    cross_talk: Sequence[str],
    departing: Sequence[str],
    n: int,
    N: int,
) -> tuple[Array, tuple[str, ...]]:
    """Return the map of experiment n of N with what departs, and its parameters after those of the loop.

    `own_map` is the map, shape (K, P), of the parameters of loop and cross-talk without departures.
    """
    departing_names = [name for name in departing if name not in loop_names]  # from what was measured
    departing_names += [
        d
        for gain, d in random_effects.DELAYS.items()
        if gain in departing_names and d not in (*loop_names, *departing_names)
    ]
    # a gain of the loop that departs takes its delay along where the loop has that delay itself
    delays = [d for gain, d in random_effects.DELAYS.items() if d in loop_names or gain in departing_names]
    names = [*loop_names, *departing_names, *cross_talk]
    extended = np.zeros((len(names), own_map.shape[1]))
    extended[[names.index(name) for name in (*loop_names, *cross_talk)]] = own_map
    departures = random_effects.deviation_map(names, departing, n, N, delays)
    return np.hstack([extended, departures]), tuple(names[len(loop_names) :])


def _dynamics(run: Telemetry, fitted: Mapping[str, float], settings: Settings) -> Array:
    """Return `dynamics.PARAMETERS` of a run as fitted, shape (7,), or else as in flight."""
    sharing = Sharing(settings.shared)
    parameters = sharing.parameters([(run, dynamics.PARAMETERS)])
    values = [fitted.get(p.name, p.value) for p in parameters]
    return sharing.matrix(run, dynamics.PARAMETERS, [p.name for p in parameters]) @ values
