"""Runs that contradict the others: a mixture of good and bad runs, exact over subsets.

A good run obeys the joint model; a bad one is off by anything. With S the bad runs (Box and Tiao 1968; Press
1997),

    log p(S) = n(S) log(prior odds) - T(without S) / 2 - d(S) / 2 log(slab) + const,

where T is the chisqr of the joint model without S, d(S) by how much its degrees of freedom fall and `slab`
the variance of a bad run in units of that of the noise (`MixturePrior`). The probability that a run is bad is
the sum of p over all subsets that hold it.

If the contradiction is beyond the budget of false alarms, the most probable subset is an answer; so is every
other one of no more runs that is about as probable, less the runs that it does not need. Where the answers
differ in one run, all of their runs are left out. Where they differ in more, or where it is about as probable
that no run is bad, as with a fault that several have in common, the data do not decide.
"""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fit.false_alarms import p_limit
from fit.statistics.consistency_test import ConsistencyTest

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MAX_SUBSETS = 10_000  # that are enumerated; larger ones grow from the most probable of these


@dataclass(frozen=True)
class MixturePrior:
    """Prior knowledge of bad runs: what the mixture assumes, and when it is decided.

    Attributes
    ----------
    odds : float
        Of a run to be bad.
    slab : float
        Variance of the residuals of a bad run, in units of that of the noise.
    margin : float
        Of log p for one bad run, within which two subsets are about as probable: noise in the rows of good
        runs makes it differ by some 2.6 between two runs, by sqrt(n) times that between n runs and n others.
    max_innocent : int
        Runs that are left out together with a bad one in whose place they may be bad.
    """

    odds: float = 1 / 50
    slab: float = 30.0
    margin: float = 8.0
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
        Those that are to be left out; empty where that is not decided.
    answers : tuple of tuple of str
        Smallest subsets of runs of which one may be bad, the most probable first.
    log_odds : float
        Of the most probable subset of bad runs to none.
    """

    probabilities: dict[str, float]
    runs: tuple[str, ...]
    answers: tuple[tuple[str, ...], ...]
    log_odds: float


def is_contradicted(
    test: ConsistencyTest, groups: Collection[frozenset[str]] = (), suspects: Collection[str] = ()
) -> bool:
    """Return whether the runs disagree by more than the budget of false alarms allows.

    Parameters
    ----------
    test : ConsistencyTest
        All runs.
    groups : collection of frozenset of str
        Names of runs that may have a fault in common, too weak to show in each of them. Those of three runs
        to less than half of all are tested as well.
    suspects : collection of str
        Names of runs that are tested with a limit of their own.
    """
    numbers = {run.name: i for i, run in enumerate(test.runs)}
    members = (sorted(numbers[name] for name in group if name in numbers) for group in groups)
    sets = [*([i] for i in numbers.values()), *(m for m in members if 2 < len(m) <= (len(numbers) - 1) // 2)]
    limit = p_limit(1 + len(sets))
    is_suspect = any(test.of_runs([numbers[name]]).p < p_limit(len(suspects)) for name in suspects)
    return is_suspect or test.total.p < limit or any(test.of_runs(runs).p < limit for runs in sets)


def find_outlier_runs(test: ConsistencyTest) -> OutlierRuns:
    """Return the probability of each run to be bad, and which are to be left out."""
    bad = np.array(list(_subsets(len(test.runs))))
    log_p = _log_probabilities(test, bad)
    while (grown := _grow(bad[np.argmax(log_p)], bad)).size:
        bad, log_p = np.vstack([bad, grown]), np.append(log_p, _log_probabilities(test, grown))
    p = np.exp(log_p - log_p.max())
    probabilities = (p / p.sum()) @ bad
    answers, is_weak = _answers(bad, log_p)
    suspects = np.any(answers, axis=0)
    count = np.count_nonzero(suspects)
    is_decided = (
        not is_weak
        and count <= np.count_nonzero(answers[0]) + PRIOR.max_innocent
        and 2 * count < len(test.runs)
        and is_contradicted(test)
    )
    names = np.array([run.name for run in test.runs])
    return OutlierRuns(
        dict(zip(names.tolist(), probabilities.tolist(), strict=True)),
        tuple(names[suspects].tolist()) if is_decided else (),
        tuple(tuple(names[answer].tolist()) for answer in answers),
        float(log_p.max() - log_p[0]),
    )


def _answers(bad: Flags, log_p: Array) -> tuple[list[Flags], bool]:
    """Return the smallest subsets about as probable as the best one, and whether it is that none is bad.

    `bad`, shape (M, R), are subsets of bad runs, the first of which is empty, with `log_p`, shape (M,).
    """
    if len(bad) == 1:  # of two runs
        return list(np.eye(bad.shape[1], dtype=bool)), True
    sizes = np.count_nonzero(bad, axis=1)
    most_probable = 1 + int(np.argmax(log_p[1:]))
    probable = log_p >= log_p[most_probable] - PRIOR.margin * math.sqrt(sizes[most_probable])
    answers: list[Flags] = []
    candidates = np.flatnonzero(probable & (sizes > 0) & (sizes <= sizes[most_probable])).tolist()
    for i in sorted(candidates, key=lambda i: (sizes[i], -log_p[i])):
        if not any(np.all(bad[i] >= answer) for answer in answers):
            answers.append(bad[i])
    return answers, bool(probable[0])


def _subsets(n: int) -> Iterator[Flags]:
    """Yield which of n runs are bad, shape (n,): none, then every subset of less than half of them."""
    count = 0
    for size in range((n - 1) // 2 + 1):
        count += math.comb(n, size)
        if count > MAX_SUBSETS:
            return
        for numbers in combinations(range(n), size):
            bad = np.zeros(n, dtype=bool)
            bad[list(numbers)] = True
            yield bad


def _grow(bad: Flags, known: Flags) -> Flags:
    """Return subsets with one more bad run than the most probable, those that are not known."""
    if 2 * (np.count_nonzero(bad) + 1) >= bad.size:
        return np.empty((0, bad.size), dtype=bool)
    known_rows = {row.tobytes() for row in known}
    grown = np.array([bad | (np.arange(bad.size) == i) for i in np.flatnonzero(~bad)])
    return grown[[row.tobytes() not in known_rows for row in grown]]


def _log_probabilities(test: ConsistencyTest, bad: Flags) -> Array:
    """Return log p of every subset of bad runs, (M, R), but for a constant, shape (M,)."""
    chi2, dof = test.chi2_of_subsets(~bad)
    n_bad = np.count_nonzero(bad, axis=1)
    return np.asarray(n_bad * math.log(PRIOR.odds) - chi2 / 2 + dof / 2 * math.log(PRIOR.slab))
