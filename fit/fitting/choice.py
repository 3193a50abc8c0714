"""Which departures the data ask for: tested one against the other on the fit without any.

Freed in every experiment, a departure lowers chi^2 by a quantity of known distribution if there is none. It
counts where that quantity has a chance below CHANCE even without the experiment that speaks most for it: what
a single experiment shows may as well be a fault of that experiment, and is left to the verdict. Whatever
counts, gains and delays are let differ between experiments first, and then do within a run what still counts.
All that is freed must explain what the experiments disagree in; else something other than gains is wrong, and
departures would only hide it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import departures, normal
from fit.fitting.departures import KINDS
from fit.fitting.hierarchy import Normal
from fit.fitting.irls import IRLSResult
from fit.model import Sharing, dynamics, wander
from fit.parallel import parallel_map
from fit.parameters import FLIGHT
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]

CHANCE = 1e-6  # of noise, below which departures are let in
WIDEST = 0.1  # relative sigma beyond which the data do not tell a departure
UNSURE = 1.5  # factor of chi^2 that noise known only from a noise run may make
UNEXPLAINED = 1e-6  # chance of what is left, below which departures explain nothing


@dataclass(frozen=True)
class _Free:
    """Departures of all experiments, all else projected out.

    Attributes
    ----------
    names : tuple of str
        What departs, by experiment: the D columns.
    runs : ndarray of int, shape (D,)
        The experiments.
    H : ndarray, shape (D, D)
        Information.
    b : ndarray, shape (D,)
        Score at none.
    """

    names: tuple[str, ...]
    runs: NDArray[np.intp]
    H: Array
    b: Array

    def given(self, freed: NDArray[np.bool_]) -> "_Free":
        """Return the same with some of them, shape (D,), free."""
        if not freed.any():
            return self
        across = self.H[:, freed] @ _inverse(self.H[np.ix_(freed, freed)])[0]
        return _Free(self.names, self.runs, self.H - across @ self.H[freed], self.b - across @ self.b[freed])

    def gain(self, which: NDArray[np.bool_]) -> tuple[float, int]:
        """Return by how much chi^2 falls when some are freed, and how many directions the data tell."""
        inverse, rank = _inverse(self.H[np.ix_(which, which)])
        b = self.b[which]
        return float(b @ inverse @ b), rank


def _inverse(H: Array) -> tuple[Array, int]:
    """Return the inverse where the data tell anything, H in units of flight values, and its rank."""
    values, vectors = np.linalg.eigh(H)
    told = values > max(WIDEST**-2, 1e-12 * float(values[-1]))
    return (vectors[:, told] / values[told]) @ vectors[:, told].T, int(told.sum())


def departing(outcome: IRLSResult, experiments: Sequence[Experiment], sharing: Sharing) -> tuple[str, ...]:
    """Return what the data of a joint fit without departures ask to depart, nothing where all is well."""
    if len(experiments) < 3 or any(block.noise is None for block in outcome.blocks):
        return ()
    theta = outcome.solution.theta
    inflations = normal.inflations(outcome.blocks, theta)
    weighed = zip(outcome.blocks, experiments, strict=True)
    blocks = parallel_map(lambda one: departures.extended(one[0], one[1].sysid.wander(one[0].tau)), weighed)
    names = [n for kind in KINDS for n in kind.parameters if sharing.groups.get(n, "campaign") == "campaign"]
    alone = normal.of_runs(blocks, theta, inflations)
    free = _free(outcome, alone, blocks, names)
    if min(_chance(free, kind.parameters) for kind in KINDS) > CHANCE:
        return ()
    # what gains do within a run looks much like what they do from run to run, and that is likelier
    chosen = [n for n in names if n in dynamics.PARAMETERS]
    more = [k for k in KINDS if not {*k.parameters} & {*dynamics.PARAMETERS}]
    while more:
        left = free.given(np.isin(free.names, chosen))
        best = min(more, key=lambda kind: _chance(left, kind.parameters))
        if _chance(left, best.parameters) > CHANCE:
            break
        chosen += best.parameters
        more.remove(best)
    return tuple(chosen) if _explained(outcome, alone, blocks, chosen) else ()


def _free(
    outcome: IRLSResult,
    alone: Sequence[Normal],
    blocks: Sequence[whitened_run.WhitenedRun],
    names: Sequence[str],
) -> _Free:
    """Return the departures of `names` in all experiments, in units of flight values."""
    N, P = len(blocks), outcome.solution.theta.size
    joined = _with_departures(outcome, alone, blocks, names)
    base = np.arange(P)
    scale = 1 / np.sqrt(np.maximum(np.diag(joined.H)[base], 1e-300))
    inverse = scale[:, None] * np.linalg.inv(scale[:, None] * joined.H[:P, :P] * scale) * scale
    across = joined.H[P:, :P] @ inverse
    unit = np.repeat([_unit(name) for name in names], N)
    H = (joined.H[P:, P:] - across @ joined.H[:P, P:]) * np.outer(unit, unit)
    b = (joined.b[P:] - across @ joined.b[:P]) * unit
    return _Free(tuple(np.repeat(names, N)), np.tile(np.arange(N), len(names)), H, b)


def _unit(name: str) -> float:
    return next(
        FLIGHT[unit].value
        for kind in KINDS
        for parameter, unit in zip(kind.parameters, kind.units, strict=True)
        if parameter == name
    )


def _with_departures(
    outcome: IRLSResult,
    alone: Sequence[Normal],
    blocks: Sequence[whitened_run.WhitenedRun],
    names: Sequence[str],
) -> Normal:
    """Return what all runs say of the parameters and of the departures of `names`, in that order."""
    N, P = len(blocks), outcome.solution.theta.size
    rows = np.hstack([outcome.prior.rows, np.zeros((len(outcome.prior.rows), N * len(names)))])
    H = rows.T @ rows
    b = -rows.T @ (outcome.prior.rows @ (outcome.solution.theta - outcome.prior.centre))
    for n, (block, own) in enumerate(zip(blocks, alone, strict=True)):
        known = len(block.share) - len(wander.NAMES)
        to_run = departures.share(block.share[:known], [*names], n, N)
        to_run = np.vstack([to_run, np.zeros((len(block.share) - len(to_run), to_run.shape[1]))])
        H += to_run.T @ own.H @ to_run
        b += to_run.T @ own.b
    return Normal(H, b, np.zeros(P + N * len(names)))


def _chance(free: _Free, parameters: Sequence[str]) -> float:
    """Return how often noise makes as much of some departures, whichever experiment is left out."""
    which = np.isin(free.names, parameters)
    if not which.any():
        return 1.0
    chances = []
    for run in range(int(free.runs.max()) + 1):
        total, rank = free.given(free.runs == run).gain(which & (free.runs != run))
        chances.append(float(scipy.special.chdtrc(rank, total)) if rank > 1 else 1.0)
    return max(chances)


def _explained(
    outcome: IRLSResult,
    alone: Sequence[Normal],
    blocks: Sequence[whitened_run.WhitenedRun],
    chosen: Sequence[str],
) -> bool:
    """Return whether, with what is chosen free, the experiments agree as well as noise lets them."""
    N = len(blocks)
    joined = _with_departures(outcome, alone, blocks, chosen)
    scale = 1 / np.sqrt(np.maximum(np.diag(joined.H), 1e-300))
    values, vectors = np.linalg.eigh(scale[:, None] * joined.H * scale)
    told = values > 1e-12 * values[-1]
    x = scale * ((vectors[:, told] / values[told]) @ (vectors[:, told].T @ (scale * joined.b)))
    left, rank = 0.0, -int(told.sum()) + len(outcome.prior.rows)
    for n, (block, own) in enumerate(zip(blocks, alone, strict=True)):
        known = len(block.share) - (0 if departures.wanders(chosen) else len(wander.NAMES))
        to_run = departures.share(block.share[: len(block.share) - len(wander.NAMES)], chosen, n, N)
        H = own.H[:known, :known]
        b = own.b[:known] - H @ to_run @ x
        size = np.sqrt(np.maximum(np.diag(H), 1e-300))
        values, vectors = np.linalg.eigh(H / np.outer(size, size))
        seen = values > 1e-10 * values[-1]
        left += float(np.sum((vectors[:, seen].T @ (b / size)) ** 2 / values[seen]))
        rank += int(seen.sum())
    return bool(scipy.special.chdtrc(max(rank, 1), left / UNSURE) > UNEXPLAINED)
