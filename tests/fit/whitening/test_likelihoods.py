"""Weights of the likelihoods, compared with a search for their maximum."""

import numpy as np
import pytest
from scipy.optimize import minimize

from fit.whitening import likelihoods


def minus_log_likelihood(kind, u, f):
    """Return the likelihood as `fit.whitening.likelihoods` states it."""
    if kind == "gaussian":
        return np.sum(u) / 2
    if kind == "student_t":
        return (likelihoods.NU + 2) / 2 * np.sum(np.log1p(u / likelihoods.NU))
    return sum(len(u[b]) * np.log(np.sum(u[b])) for b in likelihoods.frequency_bands(f))


@pytest.mark.parametrize("kind", ["gaussian", "student_t", "marginalised"])
def test_weights_lead_to_the_maximum_of_the_likelihood(kind):
    rng = np.random.default_rng(7)
    f = np.arange(1, 301) * 1e-4
    x, noise = rng.standard_normal((2, 300, 2)) @ [1, 1j]
    y = 0.7 * x + noise * np.where(rng.random(300) < 0.05, 8.0, 1.0)
    a = 0.0
    for _ in range(200):
        w = likelihoods.weights(kind, f, np.abs(y - a * x) ** 2).fit
        a = np.sum(w * (x.conj() * y).real) / np.sum(w * np.abs(x) ** 2)
    optimum = minimize(
        lambda p: minus_log_likelihood(kind, np.abs(y - p[0] * x) ** 2, f), [a + 0.1], tol=1e-12
    )
    assert a == pytest.approx(optimum.x[0], abs=1e-6)
    # and the curvature there is that of the weights
    step = 1e-3
    cost = [minus_log_likelihood(kind, np.abs(y - (a + d) * x) ** 2, f) for d in (-step, 0, step)]
    curvature = (cost[0] - 2 * cost[1] + cost[2]) / step**2
    factors = likelihoods.weights(kind, f, np.abs(y - a * x) ** 2).curvature
    assert np.sum(factors * np.abs(x) ** 2) == pytest.approx(curvature, rel=0.03)


def test_bands_hold_every_bin_once_and_enough_of_them():
    f = np.arange(1, 2200) / 21600
    bands = likelihoods.frequency_bands(f)
    assert np.concatenate([np.arange(f.size)[b] for b in bands]).tolist() == list(range(f.size))
    assert min(b.stop - b.start for b in bands) >= likelihoods.BAND
    assert likelihoods.frequency_bands(f[:10]) == [slice(0, 10)]
