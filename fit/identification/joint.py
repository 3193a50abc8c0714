"""The parameters of an identification: which there are, where they begin, what each experiment sees of them.

Those of the loop come first, then cross-talk, which is estimated along, then what departs in each experiment
where the fit lets gains or delays scatter.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.fitting import constraints, departures, hierarchy, lmfit_symbol, user_params
from fit.identification.protocol import Free, joint_parameters, share
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
class View:
    """What an experiment sees.

    Attributes
    ----------
    along : tuple of str
        Its parameters after those of the loop, see `Imposed.along`.
    share : ndarray, shape (K, P)
        Map from the P joint parameters to its K.
    """

    along: tuple[str, ...]
    share: Array


@dataclass(frozen=True)
class Joint:
    """The joint parameters.

    Attributes
    ----------
    parameters : tuple of Parameter
        The P parameters, with where the search begins.
    given : tuple of str
        Those of which it was told where.
    settings : dict of str to ParameterSettings
        Constraints and bounds, by name.
    names : tuple of str
        The parameters of the loop, by the names that it knows.
    scales : tuple of ndarray, each of shape (len(names),)
        Their natural scales, and bounds.
    departing : tuple of ScaleParameter
        The widths of departures.
    views : tuple of View
        One for each experiment.
    """

    parameters: tuple[Parameter, ...]
    given: tuple[str, ...]
    settings: dict[str, ParameterSettings]
    names: tuple[str, ...]
    scales: tuple[Array, Array, Array]
    departing: tuple[hierarchy.ScaleParameter, ...]
    views: tuple[View, ...]

    @property
    def shared(self) -> int:
        """Number of the parameters that are no departures; they come first."""
        return min((min(width.members) for width in self.departing), default=len(self.parameters))

    def named(self, theta: Array) -> dict[str, float]:
        """Return the joint parameters theta, shape (P,), by name, departures left out."""
        return dict(zip((p.name for p in self.parameters[: self.shared]), theta.tolist(), strict=False))

    def of_run(self, k: int, theta: Array) -> dict[str, float]:
        """Return the parameters of the loop in the k-th experiment by name."""
        return dict(zip(self.names, (self.views[k].share @ theta).tolist(), strict=False))


def joint(
    experiments: Sequence[Experiment],
    free: Sequence[Free],
    chosen: Settings,
    scatter: Sequence[str],
    begin: Sequence[Mapping[str, float]],
) -> Joint:
    """Join the parameters of experiments.

    Parameters
    ----------
    experiments : sequence of Experiment
        To be identified together.
    free : sequence of Free
        What is sought.
    chosen : Settings
        Tell over what cross-talk is shared.
    scatter : sequence of str
        What departs, see `departures`.
    begin : sequence of mapping of str to float
        Where the search begins: what an earlier search found, and what the fit did.
    """
    runs, N = [e.sysid.telemetry for e in experiments], len(experiments)
    departing = [n for n in scatter if all(each.shared == "campaign" for each in free if each.name == n)]
    known = {name for e in experiments for name in e.parameters}
    beside = [Free(n, shared=chosen.shared[n]) for n in dynamics.CROSS_TALK if n in known]
    found = joint_parameters((*free, *beside), runs)
    stated = constraints.of_fit(chosen.parameters, dict(zip(found, found, strict=True)))
    limits = {name: bounded(stated.get(name), *each.bounds) for name, (_, each) in found.items()}
    values = {name: s.value for name, s in limits.items() if s is not None and s.value is not None}
    default = {p.name: p.value for p, _ in found.values()}
    given = {p.name: p.value for p, each in found.values() if each.start is not None} | values
    before, fitted = begin
    where = {**default, **fitted, **given, **before}
    where |= {n: values.get(n, default[n]) for n, s in limits.items() if s is not None and not s.vary}
    start = [float(np.clip(where[n], *s.limits)) if s else where[n] for n, s in limits.items()]
    more, widths = departures.parameters(departing, [e.name for e in experiments], len(found))
    first = [each.of(runs[0]).prior_sigma for each in free]
    views = []
    for n, e in enumerate(experiments):
        own = [each for each in beside if each.name in e.parameters]
        plain = share((*free, *own), runs[n], list(found))
        views.append(_view(plain, [each.name for each in free], [each.name for each in own], departing, n, N))
    return Joint(
        parameters=(*(replace(p, value=x) for (p, _), x in zip(found.values(), start, strict=True)), *more),
        given=tuple(given),
        settings={n: s.model_copy(update={"value": None}) for n, s in limits.items() if s is not None},
        names=tuple(each.name for each in free),
        scales=(np.array(first), *np.array([each.bounds for each in free]).T),
        departing=tuple(widths),
        views=tuple(views),
    )


def make_params(free: Sequence[Free], runs: Sequence[Telemetry]) -> lmfit.Parameters:
    """Return the parameters of an identification, for `identify`: start values and bounds.

    Fix them, give them other bounds or ties as lmfit has them, or a `fit.Prior` as ``user_data``. Those of
    FMUs have an underscore for the dot: ``SuspensionControl_f_p``.

    Parameters
    ----------
    free : sequence of Free
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


def check_constraints(settings: Settings, names: Iterable[str], calibrated: Results) -> None:
    """Refuse constraints of parameters that are neither identified nor were constrained in the fit.

    Raises
    ------
    InputError
        If there are any, or a tie cannot be followed.
    """
    fitted = (calibrated.provenance.settings or {}).get("parameters", {})
    known = fitted if isinstance(fitted, Mapping) else {}
    stated = {n: s for n, s in settings.parameters.items() if "." in n or known.get(n) != s.record()}
    fitted_names = [name for name in known if "." not in name]
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
    plain: Array, sought: Sequence[str], cross_talk: Sequence[str], departing: Sequence[str], n: int, N: int
) -> View:
    """Return what experiment n of N sees; `plain`, shape (K, P), is without what departs."""
    wanted = [name for name in departing if name not in sought]  # from what was measured
    wanted += [d for gain, d in departures.DELAYS.items() if gain in wanted and d not in (*sought, *wanted)]
    # a gain of the loop that departs takes its delay along where the loop has that delay itself
    following = [d for gain, d in departures.DELAYS.items() if d in sought or gain in wanted]
    of_equation = [name for name in wanted if name in dynamics.PARAMETERS]
    within = [name for name in wanted if name not in dynamics.PARAMETERS]
    of_run = [*sought, *of_equation, *cross_talk, *within]
    share = np.zeros((len(of_run), plain.shape[1]))
    share[[of_run.index(name) for name in (*sought, *cross_talk)]] = plain
    more = departures.entering(of_run, departing, n, N, following)
    return View(tuple(of_run[len(sought) :]), np.hstack([share, more]))


def run_dynamics(experiment: Experiment, calibrated: Results, settings: Settings) -> Array:
    """Return what a calibration says of `dynamics.PARAMETERS` of a run, shape (7,), or else the flight."""
    run, sharing = experiment.sysid.telemetry, Sharing(settings.shared)
    known = calibrated.joint.values if calibrated.joint else {}
    parameters = sharing.parameters([(run, dynamics.PARAMETERS)])
    values = [known.get(p.name, p.value) for p in parameters]
    return sharing.matrix(run, dynamics.PARAMETERS, [p.name for p in parameters]) @ values
