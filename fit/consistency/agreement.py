"""Which runs are left out for the sake of the others, and what is said of those that stay.

Runs agree if no sum of squares of `consistency` is more than noise makes it: T over all runs; what falls away
from it with one run, with one parameter of one run set free, with one parameter set free in every run, and
with one fault that all runs of an authority or an epoch share (`groups`). Each of the five kinds may
raise one false alarm in 1 / ALARM campaigns, shared evenly among its members.

Where runs do not agree, the fewest are looked for without which the others do. Several choices may do that
equally well (two runs alone share a parameter, say): then all of them are left out. At least half of the runs
must remain, and agree as noise usually lets them; and no gains or delays that scatter from run to run may
explain the same about as well. Scatter makes no sigma too small, a run left out for it makes most of them so.
Otherwise nobody can tell, and the joint fit is unsound.

What is likelier is a matter of evidence, of likelihoods integrated over what they leave open: the widths of
scatter over their prior (`hierarchy`), what is wrong with an odd run over all that it may be.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fit.consistency.consistency import HELD, Regression, Squares
from fit.consistency.groups import Groups, Shift, is_shared, shifts
from fit.fitting import IRLSResult, departures, hierarchy
from fit.parameters import FLIGHT
from fit.quality import Exclusion
from fit.warnings import FitWarning
from fit.whitening import Experiment

Array = NDArray[np.float64]

ALARM = 1e-4  # of each kind of test
MARGIN = 12.0  # excess of T by which another choice must be worse: 1 in 400 by likelihood
SEARCHED = 3000  # combinations of one size that are looked through at most
HOPELESS = 1e-7  # p-value of T by an exact noise model, below which nothing else need be looked at
ORDINARY = 0.01  # p-value of T of those that remain, below which they do not agree without the odd ones
ODD = 9.2  # by which each odd run must explain more: one run in 100 is wrong
ANYTHING = 12.0  # and as much again: it may be off by anything, 400 sigma or 1
PENALTY = 9.2  # by which odd runs must explain more than gains that scatter: 100 times likelier
ASKED = 2.2  # gain from which runs are said to scatter: three times likelier than not
TELLS = 1e-3  # inverse sigma, of itself and of that of the run that tells most, from which a run tells
FEWEST = 3  # runs that tell a scatter
GAIN, DELAY = (next(kind for kind in departures.KINDS if kind.name == name) for name in ("gain", "delay"))
Kinds = tuple[departures.Kind, ...]
ALONE: tuple[Kinds, ...] = ((GAIN,), (DELAY,))
SCATTERING: tuple[Kinds, ...] = (*ALONE, (GAIN, DELAY))
GROUP = 2  # as so many runs count those that may be wrong for one reason: two that are exchanged come first
LEANS = 3.0  # factor by which a sigma grows without a run on which it rests


@dataclass(frozen=True)
class Scattering:
    """Gains, delays or both that differ from run to run, on both test masses alike, as an explanation.

    Attributes
    ----------
    kinds : tuple of Kind
        What differs.
    widths : tuple of float
        Likeliest standard deviations among the runs, relative to the flight values.
    left : Squares
        What T is with it.
    gain : float
        Twice the logarithm of how much likelier it is than none, its widths integrated over.
    """

    kinds: tuple[departures.Kind, ...]
    widths: tuple[float, ...]
    left: Squares
    gain: float

    @property
    def parameters(self) -> list[str]:
        """What differs, by name."""
        return [name for kind in self.kinds for name in kind.parameters]

    @property
    def words(self) -> str:
        """What differs, and by how much."""
        each = zip(self.kinds, self.widths, strict=True)
        return " and ".join(f"a {kind.name} that scatters by {100 * width:.2g} %" for kind, width in each)


@dataclass(frozen=True)
class Odd:
    """Runs that contradict the others, by number; without `left_out` these agree.

    Attributes
    ----------
    left_out : tuple of int
        All that may be the odd ones.
    fewest : int
        How many of them it takes.
    alike : bool
        Whether one fault that they share explains it.
    """

    left_out: tuple[int, ...]
    fewest: int
    alike: bool = False


@dataclass(frozen=True)
class Agreed:
    """The joint fit, and who takes part in it.

    Attributes
    ----------
    outcome : IRLSResult
        Of the fit.
    experiments : tuple of Experiment
        That it was made of.
    left_out : tuple of Exclusion
        Others, and why.
    warnings : tuple of FitWarning
        What is to be said of the joint fit beside.
    voices : Regression or None
        What the experiments say, where that was looked at.
    """

    outcome: IRLSResult
    experiments: tuple[Experiment, ...]
    left_out: tuple[Exclusion, ...]
    warnings: tuple[FitWarning, ...]
    voices: Regression | None = None

    @property
    def statistics(self) -> dict[str, dict[str, float]] | None:
        """What each of them says beside the others, and all of them together under an empty name."""
        if self.voices is None:
            return None
        tests = {v.name: self.voices.of_run(i) for i, v in enumerate(self.voices.voices)}
        tests[""] = self.voices.whole
        return {name: {"chi2": t.value, "dof": t.dof, "p": t.p} for name, t in tests.items()}


def agree(voices: Regression, groups: Groups = ()) -> bool:
    """Return whether nothing but noise is between the runs; `groups` may be wrong for one reason."""
    return not any(p < ALARM for p in _shared_out(voices)) and not alike(voices, groups)


def alike(voices: Regression, groups: Groups) -> list[Shift]:
    """Return the faults that groups of runs seem to share, the likeliest first."""
    found = shifts(voices, groups)
    told = (s for s in found if len(found) * s.taken.p < ALARM and is_shared(voices, s))
    return sorted(told, key=lambda s: float(f"{s.excess:.3g}"))  # the last digits are those of a machine


def _shared_out(voices: Regression) -> Iterable[float]:
    """Yield the p-value of each kind of test, the least of many taken for what it is."""
    yield voices.whole.p
    runs = range(len(voices.voices))
    yield len(runs) * min(voices.of_run(i).p for i in runs)
    single, every = [], []
    for name in voices.voices[0].names:
        columns = [voices.column(i, v.along(name)) for i, v in enumerate(voices.voices)]
        tests = [t for t in map(voices.of_columns, columns) if t.dof]
        single += [t.p for t in tests]
        if len(tests) > 1:
            every.append(voices.of_columns(np.hstack(columns)).p)
    yield max(1, len(single)) * min(single, default=1.0)
    yield max(1, len(every)) * min(every, default=1.0)


def odd_ones(voices: Regression, groups: Groups = ()) -> Odd | None:
    """Find the fewest runs without which the others agree; None if nobody can tell.

    Parameters
    ----------
    voices : Regression
        Of all runs.
    groups : collection of frozenset of str
        Runs, by name, that may be wrong for one reason, those of one authority or epoch: as one if a single
        fault explains them, as `GROUP` otherwise.
    """
    runs = range(len(voices.voices))
    most = (len(runs) - 1) // 2
    sums = _Sums(voices)
    together = [tuple(i for i in runs if voices.voices[i].name in group) for group in groups]
    others = {tuple(i for i in runs if i not in members) for members in together if len(members) <= most}
    # most of the runs too: of what they share nobody can tell; if against one group only, they are believed
    explained = [s for s in alike(voices, groups) if s.left.p > HOPELESS and s.members not in others]
    shared = {s.members: s.left for s in reversed(explained)}
    for size in range(1, most + 1):
        if math.comb(len(runs), size) > SEARCHED:
            return None
        sets = {*combinations(runs, size), *(g for g in together if size == GROUP and 0 < len(g) <= most)}
        found = _equally_good(voices, shared | {chosen: sums.without(chosen) for chosen in sets}, groups)
        # what some of a group explain too is no reason to keep the others: nothing tells that they are right
        kept = [c for c in found if c in shared or not any({*fewer} < {*c} for fewer in found)]
        if kept:
            everyone = tuple(sorted({i for chosen in kept for i in chosen}))
            left = shared.get(everyone)
            left = left if left and left.p > ORDINARY else None
            odd = Odd(everyone, len(kept[0]), alike=left is not None)
            return odd if _sane(voices, odd, left, groups) else None
    return None


class _Sums:
    """T without some of the runs, from sums over each of them."""

    def __init__(self, voices: Regression) -> None:
        parts = [*voices.rows, slice(voices.rows[-1].stop, voices.z.size)]
        self._H = np.array([voices.X[rows].T @ voices.X[rows] for rows in parts])
        self._b = np.array([voices.X[rows].T @ voices.z[rows] for rows in parts])
        self._squares = np.array([voices.z[rows] @ voices.z[rows] for rows in parts])
        self._sizes = np.array([rows.stop - rows.start for rows in parts])

    def without(self, gone: Sequence[int]) -> Squares:
        """Return T without the runs of these numbers."""
        kept = np.delete(np.arange(self._sizes.size), list(gone))
        values, vectors = np.linalg.eigh(self._H[kept].sum(axis=0))
        told = values > HELD**2
        b = vectors[:, told].T @ self._b[kept].sum(axis=0)
        taken = float(np.sum(b**2 / values[told]))
        dof = int(self._sizes[kept].sum()) - int(np.count_nonzero(told))
        return Squares(float(self._squares[kept].sum()) - taken, dof)


def _equally_good(
    voices: Regression, rest: Mapping[tuple[int, ...], Squares], groups: Groups
) -> list[tuple[int, ...]]:
    """Return the choices without which the others agree, as far as they are about as likely as the best.

    `rest` has what T is without them.
    """
    excess = {chosen: t.value - t.dof for chosen, t in rest.items() if t.p > HOPELESS}
    found: list[tuple[int, ...]] = []
    for chosen in sorted(excess, key=excess.__getitem__):
        if found and excess[chosen] > excess[found[0]] + MARGIN:
            break
        if agree(voices.without(chosen), groups):
            found.append(chosen)
    return found


def _sane(voices: Regression, odd: Odd, shared: Squares | None, groups: Groups) -> bool:
    """Return whether the odd ones are not too many, and all, and gains that scatter do not explain as much.

    `shared` is what one fault that all of them share leaves of T.
    """
    rest = voices.without(odd.left_out)
    if 2 * len(odd.left_out) >= len(voices.voices) or rest.whole.p < ORDINARY or not agree(rest, groups):
        return False
    left, causes = (shared, 1) if shared else (rest.whole, odd.fewest)
    limit = left.value + voices.whole.dof - left.dof + causes * (ODD + ANYTHING) + PENALTY
    scattered = (voices.whole.value - s.gain for s in scattering(voices))
    return min(scattered, default=np.inf) >= limit


def scattering(voices: Regression, kinds: Iterable[Kinds] = SCATTERING) -> list[Scattering]:
    """Return the gains and delays that differ, as it seems, and with which runs agree; the likeliest first.

    Parameters
    ----------
    voices : Regression
        Of all runs.
    kinds : iterable of tuple of Kind
        What is tried, together.
    """
    tried = [_scattering(voices, together) for together in kinds]
    likely = (one for one in tried if one and one.gain > ASKED and one.left.p > ALARM)
    return sorted(likely, key=lambda one: -one.gain)


def _scattering(voices: Regression, kinds: Kinds) -> Scattering | None:
    """Return how likely it is that something scatters, and by how much; None if few runs tell it."""
    columns, widths = np.zeros((voices.z.size, 0)), []
    for kind in kinds:
        Z = voices.residual_maker @ _departing(voices, kind)
        told = np.linalg.norm(Z, axis=0)
        tells = told > max(TELLS * told.max(initial=0.0), TELLS)
        if np.unique(np.flatnonzero(tells) % len(voices.voices)).size < FEWEST:
            return None
        first, columns = columns.shape[1], np.hstack([columns, Z[:, tells]])
        members = tuple(range(first, columns.shape[1]))
        widths.append(hierarchy.ScaleParameter(kind.name, members, np.ones(len(members)), kind.scale))
    ratio, log_widths = hierarchy.evidence(voices.z, columns, widths)
    each = zip(widths, np.exp(log_widths), strict=True)
    scaled = columns * np.concatenate([np.full(len(w.members), width) for w, width in each])
    taken, _ = hierarchy.absorbed(voices.z, scaled)
    whole = voices.whole
    left = Squares(whole.value - taken, whole.dof - len(kinds), whole.of_noise)
    return Scattering(tuple(kinds), tuple(np.exp(log_widths).tolist()), left, 2 * ratio)


def _departing(voices: Regression, kind: departures.Kind) -> Array:
    """Return the departures of every run, test mass by test mass, in flight values; see `departures`."""
    columns = []
    for name, unit in zip(kind.parameters, kind.units, strict=True):
        for i, v in enumerate(voices.voices):
            column = v.along(name) * FLIGHT[unit].value
            if name in departures.GAINS:  # the delay stays
                along = name.replace("lambda", "C")
                column = column + v.along(along) * FLIGHT[along].value
            columns.append(voices.column(i, column))
    return np.hstack(columns)


def leaning(voices: Regression, lost: NDArray[np.bool_]) -> dict[int, dict[int, float]]:
    """Return which parameters rest on a single run: by run, by parameter, how its sigma grows without it."""
    of_all = np.sqrt(np.diag(voices.covariance()))
    found: dict[int, dict[int, float]] = {}
    for i in range(len(voices.voices)):
        growth = np.sqrt(np.diag(voices.without((i,)).covariance())) / of_all
        grown = np.flatnonzero((growth > LEANS) & ~lost)
        if grown.size:
            found[i] = {int(k): float(growth[k]) for k in grown}
    return found
