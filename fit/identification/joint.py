"""The parameters of an identification: which there are, where they begin, what each experiment sees of them.

Those of the loop come first, then cross-talk, which is estimated along, then what departs in each experiment
where the fit lets gains or delays scatter.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.fitting import departures, hierarchy
from fit.identification.protocol import Free, joint_parameters, share
from fit.model import dynamics
from fit.parameters import Parameter
from fit.settings import Settings
from fit.whitening import Experiment

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
    bounds : tuple of ndarray, each of shape (P,)
        Least and largest values that are tried.
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
    bounds: tuple[Array, Array]
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
    low, high = np.array([each.bounds for _, each in found.values()]).T
    given = {p.name: p.value for p, each in found.values() if each.start is not None}
    before, fitted = begin
    where = {**{p.name: p.value for p, _ in found.values()}, **fitted, **given, **before}
    start = np.clip([where[name] for name in found], low, high).tolist()
    more, widths = departures.parameters(departing, [e.name for e in experiments], len(found))
    first = [each.of(runs[0]).prior_sigma for each in free]
    views = []
    for n, e in enumerate(experiments):
        own = [each for each in beside if each.name in e.parameters]
        plain = share((*free, *own), runs[n], list(found))
        views.append(_view(plain, [each.name for each in free], [each.name for each in own], departing, n, N))
    no_bound = np.full(len(more), np.inf)
    return Joint(
        parameters=(*(replace(p, value=x) for (p, _), x in zip(found.values(), start, strict=True)), *more),
        given=tuple(given),
        bounds=(np.append(low, -no_bound), np.append(high, no_bound)),
        names=tuple(each.name for each in free),
        scales=(np.array(first), *np.array([each.bounds for each in free]).T),
        departing=tuple(widths),
        views=tuple(views),
    )


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
