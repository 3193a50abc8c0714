"""The parameters of an identification: their start, and the map to those of each experiment.

Those of the loop come first, then cross-talk, which is estimated along, then what departs in each experiment
where the fit lets gains or delays scatter.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.fitting import constraints, lmfit_symbol, random_effects, user_params
from fit.identification.loop import FreeParameter, joint_parameters, parameter_map
from fit.model import Sharing, dynamics
from fit.parameters import Parameter
from fit.results import Results
from fit.settings import ParameterSettings, Settings
from fit.telemetry import Telemetry
from fit.whitening import Experiment

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ExperimentView:
    """The parameters of an experiment.

    Attributes
    ----------
    measured_names : tuple of str
        Its parameters after those of the loop, see `MeasuredInputs.measured_derivatives`.
    share : ndarray, shape (K, P)
        Map from the P joint parameters to its K.
    """

    measured_names: tuple[str, ...]
    parameter_map: Array


@dataclass(frozen=True)
class JointParameters:
    """The joint parameters.

    Attributes
    ----------
    parameters : tuple of Parameter
        The P parameters, with where the search begins.
    stated : tuple of str
        Those whose start the user states.
    settings : dict of str to ParameterSettings
        Constraints and bounds, by name.
    names : tuple of str
        The parameters of the loop, by the names that it knows.
    scales : tuple of ndarray, each of shape (len(names),)
        Their natural scales, and bounds.
    random_effects : tuple of ScaleParameter
        The widths of departures.
    views : tuple of ExperimentView
        One for each experiment.
    """

    parameters: tuple[Parameter, ...]
    stated: tuple[str, ...]
    settings: dict[str, ParameterSettings]
    names: tuple[str, ...]
    scales: tuple[Array, Array, Array]
    random_effects: tuple[random_effects.ScaleParameter, ...]
    views: tuple[ExperimentView, ...]

    @property
    def shared(self) -> int:
        """Number of the parameters that are no departures; they come first."""
        return random_effects.n_shared(self.random_effects, len(self.parameters))

    def named(self, theta: Array) -> dict[str, float]:
        """Return the joint parameters theta, shape (P,), by name, departures left out."""
        return dict(zip((p.name for p in self.parameters[: self.shared]), theta.tolist(), strict=False))

    def run_parameters(self, k: int, theta: Array) -> dict[str, float]:
        """Return the parameters of the loop in the k-th experiment by name."""
        return dict(zip(self.names, (self.views[k].parameter_map @ theta).tolist(), strict=False))


def joint(
    experiments: Sequence[Experiment],
    free: Sequence[FreeParameter],
    settings: Settings,
    scatter: Sequence[str],
    starts: Sequence[Mapping[str, float]],
) -> JointParameters:
    """Join the parameters of experiments.

    Parameters
    ----------
    experiments : sequence of Experiment
        To be identified together.
    free : sequence of FreeParameter
        The parameters of the loop.
    settings : Settings
        They state over what cross-talk is shared.
    scatter : sequence of str
        What departs, see `fit.fitting.random_effects`.
    starts : sequence of mapping of str to float
        Where the search begins: what an earlier search found, and what the fit did.
    """
    runs = [e.sysid.telemetry for e in experiments]
    varying = [p.name for p in free if p.shared != "campaign"]
    departing = [name for name in scatter if name not in varying]
    measured = {name for e in experiments for name in e.parameters}
    coupled = [FreeParameter(n, shared=settings.shared[n]) for n in dynamics.CROSS_TALK if n in measured]
    parameters = joint_parameters((*free, *coupled), runs)
    limits = _limits(parameters, settings)
    start, stated = _start(parameters, limits, starts)
    departure_parameters, widths = random_effects.parameters(
        departing, [e.name for e in experiments], len(parameters)
    )
    views = []
    for n, e in enumerate(experiments):
        cross_talk = [p for p in coupled if p.name in e.parameters]
        shared_map = parameter_map((*free, *cross_talk), runs[n], list(parameters))
        names = [p.name for p in free], [p.name for p in cross_talk]
        views.append(_view(shared_map, *names, departing, n, len(experiments)))
    return JointParameters(
        parameters=(
            *(replace(p, value=start[name]) for name, (p, _) in parameters.items()),
            *departure_parameters,
        ),
        stated=stated,
        settings={n: s.model_copy(update={"value": None}) for n, s in limits.items()},
        names=tuple(p.name for p in free),
        scales=(
            np.array([p.parameter(runs[0]).prior_sigma for p in free]),
            *np.array([p.bounds for p in free]).T,
        ),
        random_effects=tuple(widths),
        views=tuple(views),
    )


def _limits(
    parameters: Mapping[str, tuple[Parameter, FreeParameter]], settings: Settings
) -> dict[str, ParameterSettings]:
    """Return constraints and bounds by name, of parameters that have any."""
    stated = constraints.of_fit(settings.parameters, dict(zip(parameters, parameters, strict=True)))
    limits = {name: bounded(stated.get(name), *free.bounds) for name, (_, free) in parameters.items()}
    return {name: limit for name, limit in limits.items() if limit is not None}


def _start(
    parameters: Mapping[str, tuple[Parameter, FreeParameter]],
    limits: Mapping[str, ParameterSettings],
    starts: Sequence[Mapping[str, float]],
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return where the search starts, by name, and the names of which the user states it."""
    previous, fitted = starts
    stated = {name: limit.value for name, limit in limits.items() if limit.value is not None}
    defaults = {name: parameter.value for name, (parameter, _) in parameters.items()}
    stated = {n: defaults[n] for n, (_, free) in parameters.items() if free.start is not None} | stated
    values = {**defaults, **fitted, **stated, **previous}
    values |= {n: stated.get(n, defaults[n]) for n, limit in limits.items() if not limit.vary}
    values |= {n: float(np.clip(values[n], *limit.limits)) for n, limit in limits.items()}
    return values, tuple(stated)


def make_params(free: Sequence[FreeParameter], runs: Sequence[Telemetry]) -> lmfit.Parameters:
    """Return the parameters of an identification, for `identify`: start values and bounds.

    Fix them, give them other bounds or ties as lmfit has them, or a `fit.Prior` as ``user_data``. Those of
    FMUs have an underscore for the dot: ``SuspensionControl_f_p``.

    Parameters
    ----------
    free : sequence of FreeParameter
        The parameters.
    runs : sequence of Telemetry
        With injections, one of each experiment.
    """
    parameters = joint_parameters(free, runs)
    settings = {name: bounded(None, *p.bounds) for name, (_, p) in parameters.items()}
    return user_params.constrained_params(
        [parameter for parameter, _ in parameters.values()],
        {name: setting for name, setting in settings.items() if setting},
    )


def with_params(settings: Settings, params: lmfit.Parameters, names: Iterable[str]) -> Settings:
    """Return settings with the constraints of `params`, which may be of the parameters `names`.

    Raises
    ------
    InputError
        If `params` are no lmfit.Parameters, or a prior is no `Prior`.
    """
    by_symbol = {lmfit_symbol(name): name for name in names}
    stated = {
        by_symbol.get(name, name): ParameterSettings.model_validate(constraint)
        for name, constraint in user_params.as_settings(params).items()
    }
    return settings.model_copy(update={"parameters": {**settings.parameters, **stated}})


def without_constraints(settings: Settings) -> Settings:
    """Return settings that leave all parameters free; where a search starts, the user may still state."""
    free = {name: p for name, p in settings.parameters.items() if not p.is_constraint}
    starts = {
        name: ParameterSettings(value=p.value)
        for name, p in settings.parameters.items()
        if p.is_constraint and p.vary and p.value is not None
    }
    return settings.model_copy(update={"parameters": {**free, **starts}})


def check_constraints(settings: Settings, names: Iterable[str], calibrated: Results) -> None:
    """Refuse constraints of parameters that are neither identified nor were constrained in the fit.

    Raises
    ------
    InputError
        If there are any, or a tie cannot be followed.
    """
    fitted = (calibrated.provenance.settings or {}).get("parameters", {})
    fitted_constraints = fitted if isinstance(fitted, Mapping) else {}
    stated = {
        n: s for n, s in settings.parameters.items() if "." in n or fitted_constraints.get(n) != s.record()
    }
    fitted_names = [name for name in fitted_constraints if "." not in name]
    constraints.check(stated, [*names, *fitted_names], "fit.parameters", has_fmus=True)


def bounded(stated: ParameterSettings | None, low: float, high: float) -> ParameterSettings | None:
    """Return what a user states of a parameter, within the bounds of the search where it states none."""
    setting = stated or ParameterSettings()
    if setting.expr or not setting.vary:
        return setting
    lower, upper = (None if np.isinf(bound) else float(bound) for bound in (low, high))
    limits = {
        "min": lower if setting.min is None else setting.min,
        "max": upper if setting.max is None else setting.max,
    }
    setting = setting.model_copy(update=limits)
    return setting if setting.is_constraint or setting.value is not None else None


def _view(
    shared_map: Array,
    loop_names: Sequence[str],
    cross_talk: Sequence[str],
    departing: Sequence[str],
    n: int,
    N: int,
) -> ExperimentView:
    """Return what experiment n of N sees; `shared_map`, shape (K, P), is without what departs."""
    departing_names = [name for name in departing if name not in loop_names]  # from what was measured
    departing_names += [
        d
        for gain, d in random_effects.DELAYS.items()
        if gain in departing_names and d not in (*loop_names, *departing_names)
    ]
    # a gain of the loop that departs takes its delay along where the loop has that delay itself
    delays = [d for gain, d in random_effects.DELAYS.items() if d in loop_names or gain in departing_names]
    run_parameters = [*loop_names, *departing_names, *cross_talk]
    parameter_map = np.zeros((len(run_parameters), shared_map.shape[1]))
    parameter_map[[run_parameters.index(name) for name in (*loop_names, *cross_talk)]] = shared_map
    departure_map = random_effects.deviation_map(run_parameters, departing, n, N, delays)
    return ExperimentView(tuple(run_parameters[len(loop_names) :]), np.hstack([parameter_map, departure_map]))


def run_dynamics(experiment: Experiment, calibrated: Results, settings: Settings) -> Array:
    """Return `dynamics.PARAMETERS` of a run as calibrated, shape (7,), or else as in flight."""
    run, sharing = experiment.sysid.telemetry, Sharing(settings.shared)
    fitted_values = calibrated.joint.values if calibrated.joint else {}
    parameters = sharing.parameters([(run, dynamics.PARAMETERS)])
    values = [fitted_values.get(p.name, p.value) for p in parameters]
    return sharing.matrix(run, dynamics.PARAMETERS, [p.name for p in parameters]) @ values
