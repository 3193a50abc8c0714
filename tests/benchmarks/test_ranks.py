"""The simultaneous band of ranks: against the exact chance of staying inside, and against wrong ranks."""

import numpy as np
import pytest
from scipy.stats import binom, norm

from tests.benchmarks import ranks

pytestmark = pytest.mark.stat


def staying(n, z, low, high):
    """Return the chance that the counts of n uniform ranks below all z lie within bounds, exactly.

    From one z to the next each rank that is left falls between with the chance that the gap has of the rest.
    """
    chances = np.zeros(n + 1)
    chances[0] = 1.0
    before = 0.0
    counts = np.arange(n + 1)
    for at, least, most in zip(z, low, high, strict=True):
        share = (at - before) / (1 - before)
        step = binom.pmf(counts[:, None] - counts, n - counts, share)  # from columns to rows
        chances = step @ chances
        chances[(counts < least) | (counts > most)] = 0.0
        before = at
    return chances.sum()


@pytest.mark.parametrize("n", [20, 75, 200])
@pytest.mark.parametrize("outside", [0.05, 0.32])
def test_band_holds_the_share_of_curves_that_it_says(n, outside):
    z, low, high = ranks.band(n, outside)
    held = staying(n, z, np.round(n * low), np.round(n * high))
    # counts come in steps, and the level from 10,000 sets: five standard deviations
    assert held == pytest.approx(1 - outside, abs=5 * np.sqrt(outside * (1 - outside) / ranks.SETS) + 0.015)


def test_chances_of_uniform_ranks_are_uniform():
    rng = np.random.default_rng(1)
    found = np.array([ranks.chance(rng.uniform(size=200)) for _ in range(400)])
    # 400 draws: five standard deviations, once in two million
    for level in (0.05, 0.3, 0.6):
        assert np.mean(found <= level) == pytest.approx(level, abs=5 * np.sqrt(level * (1 - level) / 400))


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("sigmas too small", lambda x: x / 0.8),
        ("sigmas too large", lambda x: x / 1.25),
        ("bias", lambda x: x + 0.3),
    ],
)
def test_wrong_ranks_leave_the_band(name, wrong):
    rng = np.random.default_rng(2)
    pulls = rng.standard_normal(1000)
    z, low, high = ranks.band(1000)

    def inside(pulls):
        below = (np.sort(norm.cdf(pulls)) <= z[:, None]).mean(axis=1)
        return np.all((below >= low) & (below <= high))

    assert inside(pulls)
    assert ranks.chance(norm.cdf(pulls)) > 0.05
    assert not inside(wrong(pulls))
    assert ranks.chance(norm.cdf(wrong(pulls))) < 1e-3
