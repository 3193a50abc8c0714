"""Widths integrated over, against dense algebra of Gaussians and sums over fine grids."""

import numpy as np
import pytest
from scipy.stats import halfcauchy

from fit.fitting.random_effects import ScaleParameter
from fit.fitting.width_posterior import NormalEquations, conditional, marginalise

WEAK = 10.0  # sigma of the prior of what does not depart


@pytest.fixture(params=[1, 2])
def case(request):
    """Twelve departures beside two values, in one group or two: normal equations, and data."""
    rng = np.random.default_rng(request.param)
    design = rng.standard_normal((40, 14))
    units = np.array([2.0] * 6 + [0.5] * 6)
    widths = {
        1: [ScaleParameter("both", tuple(range(2, 14)), units, 0.7)],
        2: [
            ScaleParameter("first", tuple(range(2, 8)), units[:6], 0.7),
            ScaleParameter("second", tuple(range(8, 14)), units[6:], 0.2),
        ],
    }[request.param]
    truth = np.concatenate([[3.0, -2.0], 0.6 * units * rng.standard_normal(12)])
    y = design @ truth + 0.7 * rng.standard_normal(40)
    origin = np.concatenate([[1.0, 1.0], np.zeros(12)])
    weak = np.diag(np.concatenate([np.ones(2), np.zeros(12)])) / WEAK**2
    normal = NormalEquations(
        design.T @ design + weak, design.T @ (y - design @ origin) - weak @ origin, origin
    )
    return normal, widths, design, y


def dense(design, y, widths, values):
    """Return log density of the data, and mean and covariance of the parameters, from joint covariances."""
    sigma = np.full(14, WEAK)
    for width, value in zip(widths, values, strict=True):
        sigma[list(width.members)] = value * width.units
    V = (design * sigma**2) @ design.T + np.eye(len(y))
    gain = (sigma[:, None] ** 2 * design.T) @ np.linalg.inv(V)
    covariance = np.diag(sigma**2) - gain @ design * sigma**2
    log = -(np.linalg.slogdet(V)[1] + y @ np.linalg.solve(V, y)) / 2
    return log, gain @ y, covariance


def test_given_the_widths_everything_is_normal(case):
    normal, widths, design, y = case
    points = [np.array([0.3, 0.9])[: len(widths)], np.array([1.5, 0.1])[: len(widths)]]
    ours = [conditional(normal, widths, np.log(values)) for values in points]
    oracle = [dense(design, y, widths, values) for values in points]
    for (_, mean, covariance), (_, expected, of_mean) in zip(ours, oracle, strict=True):
        assert mean == pytest.approx(expected, abs=1e-9)
        assert covariance == pytest.approx(of_mean, abs=1e-9)
    prior = [
        sum(
            halfcauchy(scale=w.scale).logpdf(v) + np.log(v)  # of the logarithm
            for w, v in zip(widths, values, strict=True)
        )
        for values in points
    ]
    likelihoods = oracle[0][0] - oracle[1][0]
    assert ours[0][0] - ours[1][0] == pytest.approx(likelihoods + prior[0] - prior[1], abs=1e-9)


def test_the_posterior_is_the_sum_over_all_widths(case):
    normal, widths, design, y = case
    posterior = marginalise(normal, widths)
    t, of_t = np.polynomial.legendre.leggauss(60 if len(widths) == 1 else 36)
    t, of_t = (t + 1) / 2, of_t / 2  # w = t / (1 - t), so that all widths lie between 0 and 1
    grid = np.stack(np.meshgrid(*[t / (1 - t)] * len(widths)), axis=-1).reshape(-1, len(widths))
    volume = np.prod(np.stack(np.meshgrid(*[of_t / (1 - t) ** 2] * len(widths)), axis=-1), axis=-1).ravel()
    log, means, covariances = zip(*(dense(design, y, widths, values) for values in grid), strict=True)
    log = np.array(log) + sum(halfcauchy(scale=w.scale).logpdf(grid[:, i]) for i, w in enumerate(widths))
    log += np.log(volume)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = weight @ np.array(means)
    away = np.array(means) - mean
    covariance = np.einsum("n,nij->ij", weight, covariances) + (weight * away.T) @ away
    sigma = np.sqrt(np.diag(covariance))
    assert np.abs((posterior.mean - mean) / sigma).max() < 0.01
    assert np.sqrt(np.diag(posterior.covariance)) == pytest.approx(sigma, rel=0.01)
    assert posterior.covariance / np.outer(sigma, sigma) == pytest.approx(
        covariance / np.outer(sigma, sigma), abs=0.01
    )
    assert posterior.widths == pytest.approx(weight @ grid, rel=0.02)
    assert posterior.sigmas == pytest.approx(np.sqrt(weight @ (grid - weight @ grid) ** 2), rel=0.05)


def test_the_grid_finds_widths_far_from_their_prior():
    # departures known exactly: the posterior is that of a standard deviation, here 30 scales wide
    rng = np.random.default_rng(0)
    d = 3.0 * rng.standard_normal(40)
    width = ScaleParameter("w", tuple(range(40)), np.ones(40), 0.1)
    posterior = marginalise(NormalEquations(1e8 * np.eye(40), 1e8 * d, np.zeros(40)), [width])
    assert posterior.widths[0] == pytest.approx(np.sqrt(np.mean(d**2)), rel=0.03)
    assert posterior.sigmas[0] == pytest.approx(posterior.widths[0] / np.sqrt(80), rel=0.1)


def test_where_the_data_say_nothing_the_width_is_that_of_the_prior():
    width = ScaleParameter("w", (0,), np.ones(1), 0.1)
    normal = NormalEquations(np.diag([1e-12]), np.zeros(1), np.zeros(1))
    assert marginalise(normal, [width]).log_widths[0] == pytest.approx(np.log(0.1), abs=0.05)
