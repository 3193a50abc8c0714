"""The smooth PSD without what each bin has told of itself: against a fit that does without that bin."""

import numpy as np
import scipy

from fit.spectra.noise_psd import fit_noise

F = np.arange(1, 601) / 6000.0
TRUE = 1 + (0.01 / F) ** 4


def drawn(seed):
    power = np.random.default_rng(seed).exponential(size=F.size) * TRUE
    return power, fit_noise(F, power, np.ones(F.size))


def test_power_beside_a_bin_is_independent_of_its_own():
    # The 16 knots of 600 bins tie the one to the other by 16/600; the mean over 40 draws is good to 0.002.
    own, beside = [], []
    for power, model in map(drawn, range(40)):
        excess = power / TRUE - 1
        own.append(np.mean(excess * np.log(model(F) / TRUE)))
        beside.append(np.mean(excess * np.log(model.leave_one_out(F, power) / TRUE)))
    assert abs(np.mean(own) - 16 / 600) < 0.006
    assert abs(np.mean(beside)) < 0.006


def test_the_basis_is_that_of_natural_splines():
    rng, model = np.random.default_rng(3), drawn(5)[1]
    f = np.concatenate([[F[0] / 3], F, [2 * F[-1]]])  # beyond the knots it goes straight on
    u, inside = np.log(f), np.clip(np.log(f), model.knots[0], model.knots[-1])
    spline = scipy.interpolate.CubicSpline(model.knots, np.eye(model.knots.size), bc_type="natural")
    dense, basis = spline(inside) + spline(inside, 1) * (u - inside)[:, None], model.basis(f)
    x, weights, rows = rng.standard_normal(f.size), rng.random(f.size), rng.standard_normal((3, f.size))
    variance = np.sum((dense @ model.covariance) * dense, axis=1)
    for found, expected in (
        (basis @ model.values, dense @ model.values),
        (basis.summed(x), dense.T @ x),
        (basis.summed(rows), rows @ dense),
        (model.basis(f[::-1].copy()) @ model.values, dense[::-1] @ model.values),
        (basis.products(weights), (dense.T * weights) @ dense),
        (basis.variance(model.covariance), variance),
    ):
        assert np.allclose(found, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())
