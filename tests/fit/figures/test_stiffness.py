"""Figure of the stiffness of a test mass: the distance of experiments from the model."""

import numpy as np
import pytest

from fit.figures.stiffness import StiffnessPoint, stiffness_pull
from fit.results import Estimate, Fit


@pytest.mark.stat
def test_pulls_of_the_stiffness_model_are_normal():
    # Seven stiffnesses of the same model, fitted by least squares here: 300 campaigns make 2100 pulls, whose
    # standard deviation is known to 1.8 % if they were independent; 6 % is beyond 3 sigma. Seed fixed.
    rng = np.random.default_rng(21)
    F = 1e-12 * np.array([2200.0, 1100.0, 1100.0, 50.0, 2200.0, 2200.0, 5000.0])
    N = 1e-12 * np.array([10.4, 10.4, 1.0, 1.0, 10.4, 1.0, 10.4])
    sigma = 1e-9 * np.array([9.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.7])
    design = np.stack([np.ones(7), F, N], axis=1)
    covariance = np.linalg.inv((design / sigma[:, None] ** 2).T @ design)
    truth = np.array([-4.19e-7, -317.0, -27.4e3])
    names = ("omega2_2_0", "alpha_x_2", "alpha_phi_2")
    pulls, independent_pulls = [], []
    for _ in range(300):
        measured = design @ truth + sigma * rng.standard_normal(7)
        estimate = covariance @ (design.T @ (measured / sigma**2))
        parameters = {n: Estimate(v, 1.0, "") for n, v in zip(names, estimate, strict=True)}
        model = Fit(parameters, covariance, 1.0, 1, True, ())
        points = [
            StiffnessPoint("", 2, f, n, Estimate(m, s, "s-2"))
            for f, n, m, s in zip(F, N, measured, sigma, strict=True)
        ]
        pulls += [stiffness_pull(point, model) for point in points]
        independent = StiffnessPoint(
            "", 2, F[0], N[0], Estimate(design[0] @ truth + 4e-9 * rng.standard_normal(), 4e-9, "s-2"), False
        )
        independent_pulls.append(stiffness_pull(independent, model))
    assert np.std(pulls) == pytest.approx(1, rel=0.06)
    assert np.std(independent_pulls) == pytest.approx(1, rel=0.15)  # 300: 4 %
