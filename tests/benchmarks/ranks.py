"""Are ranks uniform? Bands within which the empirical distribution of uniform ranks stays as a whole.

The share of n ranks below z has the same binomial distribution at every z; what a band must hold is the whole
curve. Its edges are quantiles of these distributions, all at the one level that holds 95 % of the curves of
uniform ranks, found by simulation (Saeilynoja, Buerkner, Vehtari, Statistics and Computing 32, 2022).
"""

from functools import lru_cache

import numpy as np
from scipy.stats import binom

Array = np.ndarray

POINTS = 100  # at which curves are compared with the band
SETS = 10_000  # of uniform ranks that are drawn
SEED = 2022


def instants(n: int) -> Array:
    """Return where the curves of n ranks are looked at, inside of 0 and 1."""
    points = min(n, POINTS)
    return np.arange(1, points) / points


@lru_cache(maxsize=16)
def _chances(n: int) -> Array:
    """Return how often a count below z is as far out as it is, shape (n + 1, points), both sides together."""
    counts, z = np.arange(n + 1)[:, None], instants(n)
    return 2 * np.minimum(binom.cdf(counts, n, z), binom.sf(counts - 1, n, z))


def _strayed(below: Array, n: int) -> Array:
    """Return the least chance along curves, the counts below every z, shape (..., points)."""
    return _chances(n)[below, np.arange(below.shape[-1])].min(axis=-1)


@lru_cache(maxsize=16)
def _uniform(n: int) -> Array:
    """Return the least chances of sets of n uniform ranks, sorted."""
    share = np.diff([*instants(n), 1.0], prepend=0.0)
    drawn = np.random.default_rng([SEED, n]).multinomial(n, share, size=SETS)
    return np.sort(_strayed(np.cumsum(drawn, axis=1)[:, :-1], n))


def chance(ranks: Array) -> float:
    """Return how often uniform ranks stray as far as these, shape (n,)."""
    below = (ranks[:, None] <= instants(ranks.size)).sum(axis=0)
    return float(np.searchsorted(_uniform(ranks.size), _strayed(below, ranks.size), side="right") / SETS)


def band(n: int, outside: float = 0.05) -> tuple[Array, Array, Array]:
    """Return z, and the shares below z between which all but `outside` of the curves of n ranks stay."""
    level = float(np.quantile(_uniform(n), outside))
    z = instants(n)
    return z, binom.ppf(level / 2, n, z) / n, binom.isf(level / 2, n, z) / n
