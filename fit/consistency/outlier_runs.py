"""Runs that contradict the others: a mixture of good and bad runs, exact over subsets.

A good run obeys the joint model; a bad one is off by anything. With S the bad runs (Box and Tiao 1968; Press
1997),

    log p(S) = n(S) log(prior odds) - T(without S) / 2 - d(S) / 2 log(slab) + const,

where T is the chisqr of the joint model without S, d(S) by how much its degrees of freedom fall and `slab`
the variance of a bad run in units of that of the noise (`MixturePrior`). The runs of one authority or one
alignment epoch may all be bad for one reason and count as one. The probability that a run is bad is the sum
of p over all subsets that hold it. Above one half the run is left out, if the contradiction itself is beyond
the budget of false alarms; of two that may about as well be bad, both are,
and of a group that may about as well be bad as most of its runs, or where little decides, all are.
"""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fit.consistency.consistency_test import ConsistencyTest
from fit.false_alarms import p_limit

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MAX_SUBSETS = 10_000  # that are enumerated; larger ones grow from the most probable of these
LEVERAGE = 3.0  # factor by which a sigma grows without a run that determines it almost alone

#: Names of the runs of each group that may be bad for one reason.
Groups = Collection[frozenset[str]]


@dataclass(frozen=True)
class MixturePrior:
    """Prior knowledge of bad runs: what the mixture assumes, and when it is decided.

    Attributes
    ----------
    odds : float
        Of a run, or of a group of runs, to be bad.
    slab : float
        Variance of the residuals of a bad run, in units of that of the noise.
    margin : float
        Of log p, within which two subsets are about as probable: noise in the rows of good runs makes it
        differ by some 2.5 between two runs.
    max_innocent : int
        Runs that are left out together with a bad one in whose place they may be bad.
    """

    odds: float = 1 / 50
    slab: float = 30.0
    margin: float = 6.0
    max_innocent: int = 1


PRIOR = MixturePrior()


@dataclass(frozen=True)
class OutlierRuns:
    """Which runs contradict the others.

    Attributes
    ----------
    probabilities : dict of str to float
        By run, that it is bad.
    runs : tuple of str
        Those that are to be left out.
    undecided : tuple of str
        Those that may be bad, where several subsets are about as probable.
    log_odds : float
        Of the most probable subset of bad runs to none.
    """

    probabilities: dict[str, float]
    runs: tuple[str, ...]
    undecided: tuple[str, ...]
    log_odds: float


def n_tests(test: ConsistencyTest, groups: Groups = ()) -> int:
    """Return the number of tests of consistency: of all runs, of each run, of each group."""
    return 1 + len(test.runs) + len(_members(test, groups))


def is_contradicted(test: ConsistencyTest, groups: Groups = ()) -> bool:
    """Return whether the runs disagree by more than the budget of false alarms allows."""
    limit = p_limit("runs", n_tests(test, groups))
    if test.total.p < limit:
        return True
    sets = [*([i] for i in range(len(test.runs))), *_members(test, groups)]
    return any(test.of_runs(sorted(numbers)).p < limit for numbers in sets)


def find_outlier_runs(test: ConsistencyTest, groups: Groups = ()) -> OutlierRuns:
    """Return the probability of each run to be bad, and which are to be left out.

    Parameters
    ----------
    test : ConsistencyTest
        All runs.
    groups : collection of frozenset of str
        Runs, by name, that may be bad for one reason.
    """
    good = np.array(list(_good_runs(test, groups)))
    log_p = _log_probabilities(test, good, groups)
    while (grown := _grow(good[np.argmax(log_p)], good)).size:
        good, log_p = np.vstack([good, grown]), np.append(log_p, _log_probabilities(test, grown, groups))
    p = np.exp(log_p - log_p.max())
    bad = (p / p.sum()) @ ~good
    names = [run.name for run in test.runs]
    reasons = _reasons(test, good, groups)
    order = np.argsort(-log_p, kind="stable")
    is_probable = (log_p > log_p.max() - PRIOR.margin) & (reasons <= reasons[order[0]])
    probable = good[order[is_probable[order]]]
    log_odds = float(log_p.max() - log_p[0])
    outliers, undecided = _decide(test, bad, probable, groups, is_weak=log_odds < 2 * PRIOR.margin)
    return OutlierRuns(
        dict(zip(names, bad.tolist(), strict=True)),
        tuple(names[i] for i in outliers),
        tuple(names[i] for i in undecided),
        log_odds,
    )


def _decide(
    test: ConsistencyTest, bad: Array, probable: Flags, groups: Groups, *, is_weak: bool
) -> tuple[list[int], list[int]]:
    """Return the runs to leave out, or where that is not decided those that may be bad, by number.

    Parameters
    ----------
    test : ConsistencyTest
        All runs.
    bad : ndarray, shape (R,)
        Probability of each run to be bad.
    probable : ndarray of bool, shape (M, R)
        Good runs of the subsets that are about as probable as the most probable one, for no more reasons,
        in falling order.
    groups : collection of frozenset of str
        Runs, by name, that may be bad for one reason.
    is_weak : bool
        Whether the most probable subset is not much more probable than no bad run.
    """
    if not is_contradicted(test, groups):
        return [], []
    outliers = np.flatnonzero(bad > 0.5).tolist()
    # a strong fault that they share would stand out in most of them
    is_credible = is_weak | (np.count_nonzero(~probable, axis=1) < 2 * len(outliers))
    shared = probable[_is_group(test, probable, groups) & ~probable[:, outliers].any(axis=1) & is_credible]
    if outliers and len(shared):
        outliers = np.flatnonzero(~shared[0]).tolist()
    in_place = probable[probable[:, outliers].any(axis=1)]
    doubtful = sorted({*outliers, *np.flatnonzero((~in_place).any(axis=0)).tolist()})
    decided = len(doubtful) <= len(outliers) + PRIOR.max_innocent and 2 * len(doubtful) < len(bad)
    return (doubtful, []) if decided else ([], doubtful)


def _members(test: ConsistencyTest, groups: Groups) -> list[frozenset[int]]:
    """Return the runs of each group of three to less than half of them, by number."""
    numbers = {run.name: i for i, run in enumerate(test.runs)}
    members = (frozenset(numbers[name] for name in group if name in numbers) for group in groups)
    return [m for m in dict.fromkeys(members) if 2 < len(m) <= (len(test.runs) - 1) // 2]


def _good_runs(test: ConsistencyTest, groups: Groups) -> Iterator[Flags]:
    """Yield which runs are good, shape (R,): all, then all but every subset and group that may be bad."""
    n, count = len(test.runs), 0
    subsets: dict[frozenset[int], None] = {}
    for size in range((n - 1) // 2 + 1):
        count += math.comb(n, size)
        if count > MAX_SUBSETS:
            break
        subsets |= dict.fromkeys(map(frozenset, combinations(range(n), size)))
    subsets |= dict.fromkeys(_members(test, groups))
    for subset in subsets:
        good = np.ones(n, dtype=bool)
        good[list(subset)] = False
        yield good


def _grow(good: Flags, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return subsets with one more bad run than the most probable, those that are not known."""
    if 2 * (np.count_nonzero(~good) + 1) >= good.size:
        return np.empty((0, good.size), dtype=bool)
    known_rows = {row.tobytes() for row in known}
    grown = np.array([good & (np.arange(good.size) != i) for i in np.flatnonzero(good)])
    return grown[[row.tobytes() not in known_rows for row in grown]]


def _log_probabilities(test: ConsistencyTest, good: Flags, groups: Groups) -> Array:
    """Return log p of every subset, good runs of shape (M, R), but for a constant, shape (M,).

    Runs of a group that are bad for one reason still agree with each other.
    """
    chi2, dof = test.chi2_of_subsets(good)
    is_group = _is_group(test, good, groups)
    chi2_alike, dof_alike = test.chi2_of_subsets(~good[is_group])
    chi2[is_group] += chi2_alike
    dof[is_group] += dof_alike
    reasons = _reasons(test, good, groups)
    return np.asarray(reasons * math.log(PRIOR.odds) - chi2 / 2 + dof / 2 * math.log(PRIOR.slab))


def _reasons(test: ConsistencyTest, good: Flags, groups: Groups) -> NDArray[np.intp]:
    """Return for how many reasons runs are bad, shape (M,)."""
    return np.where(_is_group(test, good, groups), 1, np.count_nonzero(~good, axis=1))


def _is_group(test: ConsistencyTest, good: Flags, groups: Groups) -> Flags:
    """Return which subsets of bad runs are those of a group, shape (M,)."""
    members = {_key(m, good.shape[1]) for m in _members(test, groups)}
    return np.array([row.tobytes() in members for row in good], dtype=bool)


def _key(bad: Collection[int], n: int) -> bytes:
    """Return what identifies the good runs among n where some are bad."""
    return bytes(0 if i in bad else 1 for i in range(n))


def leverage(test: ConsistencyTest, undetermined: Flags) -> dict[str, dict[int, float]]:
    """Return the parameters that a single run determines almost alone: by run, how much sigma grows."""
    sigma = np.sqrt(np.diag(test.covariance()))
    growths: dict[str, dict[int, float]] = {}
    for i, run in enumerate(test.runs):
        growth = np.sqrt(np.diag(test.without((i,)).covariance())) / sigma
        places = np.flatnonzero((growth > LEVERAGE) & ~undetermined)
        if places.size:
            growths[run.name] = {int(k): float(growth[k]) for k in places}
    return growths
