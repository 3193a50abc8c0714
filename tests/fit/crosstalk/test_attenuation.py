"""What noise in read-outs of motion does to estimates: sigmas that hold it, values that are freed of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from fit.crosstalk.attenuation import AttenuationCorrected, apply_iv, inflate_sigma
from fit.results.estimates import Estimate
from fit.results.results import Fit

NAMES = ("lambda_2", "delta_ifo_1", "delta_ifo_2")
EXPECTED = np.array([0.02, np.nan, 0.02])  # of least squares


def fit_of(names, sigma, correlation=0.0):
    covariance = np.outer(sigma, sigma) * (np.eye(len(names)) * (1 - correlation) + correlation)
    estimates = {name: Estimate(1.0, float(s), "1") for name, s in zip(names, sigma, strict=True)}
    return Fit(estimates, covariance, 1.0, 1, True, ())


def solved(theta, sigma):
    return SimpleNamespace(theta=np.array(theta), sigma=np.array(sigma))


def outcomes(after, wider):
    """Return a fit by least squares, and one with instruments in which other values come out."""
    parameters = [SimpleNamespace(name=name) for name in NAMES]
    before = SimpleNamespace(parameters=parameters, solution=solved([1.0] * 3, [0.1] * 3))
    freed = SimpleNamespace(solution=solved(after, wider))
    return before, freed


def test_sigmas_hold_what_attenuation_may_be():
    found = inflate_sigma(
        fit_of(("b_3", "b_4", "b_5"), np.array([1.0, 1.0, 1.0]), 0.2), {"b_3": 3.0, "b_4": 0.5}
    )
    assert found.parameters["b_3"].sigma == pytest.approx(np.sqrt(10))
    assert found.parameters["b_4"] == found.parameters["b_5"] == Estimate(1.0, 1.0, "1")
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx([np.sqrt(10), 1, 1])
    assert found.covariance[0, 1] == pytest.approx(0.2)


def test_what_cannot_be_told_is_withheld():
    found = inflate_sigma(fit_of(("b_3", "b_4", "b_5"), np.array([1.0, 2.0, 3.0])), {"b_4": float("nan")})
    assert list(found.parameters) == ["b_3", "b_5"]
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx([1, 3])


def test_what_moves_is_as_it_is_beside_free_couplings():
    joint = fit_of(NAMES, np.array([0.1, 0.2, 0.1]), 0.5)  # scatter has widened one of them
    before, freed = outcomes([0.98, 1.3, 1.005], [0.09, 0.12, 0.2])
    found = apply_iv(
        joint,
        before,
        AttenuationCorrected(SimpleNamespace(names={"b_3_1"}, outcome=freed), np.zeros(3), EXPECTED),
    )
    assert found.parameters["lambda_2"] == Estimate(0.98, pytest.approx(0.1), "1")
    assert found.parameters["delta_ifo_1"] == Estimate(1.3, pytest.approx(0.2 * 1.2), "1")
    assert found.parameters["delta_ifo_2"] == joint.parameters["delta_ifo_2"]  # it has not moved
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx([0.1, 0.2 * 1.2, 0.1])
    assert np.allclose(found.correlation, joint.correlation)
    (told,) = found.warnings
    assert (told.code, told.parameters) == ("instrumental_variables", ("lambda_2", "delta_ifo_1"))
    assert "lambda_2 (+0.2), delta_ifo_1 (-3.0)" in told.message
    kept = apply_iv(
        joint,
        before,
        AttenuationCorrected(SimpleNamespace(names={"b_3_1"}, outcome=freed), np.zeros(3), np.zeros(3)),
    )
    assert kept is joint  # what moved is chance: no shift was to be expected


def test_without_instruments_nothing_moves():
    joint = fit_of(NAMES, np.array([0.1, 0.2, 0.1]))
    before, same = outcomes([1.0] * 3, [0.1] * 3)
    assert (
        apply_iv(
            joint,
            before,
            AttenuationCorrected(SimpleNamespace(names=set(), outcome=same), np.zeros(3), EXPECTED),
        )
        is joint
    )
    left = apply_iv(
        joint,
        before,
        AttenuationCorrected(
            SimpleNamespace(names=set(), outcome=same), np.array([0.0, 0.2, np.nan]), EXPECTED
        ),
    )
    assert left.parameters["delta_ifo_1"] == Estimate(1.0, pytest.approx(0.2 * np.sqrt(5)), "1")
    assert left.parameters["delta_ifo_2"] == joint.parameters["delta_ifo_2"]
