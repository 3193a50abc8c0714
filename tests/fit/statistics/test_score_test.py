"""Refitted columns and further effects against a least-squares fit of everything together."""

import numpy as np
import pytest

from fit.statistics.score_test import ScoreTest

RNG = np.random.default_rng(3)
J, E, NOISE = (RNG.standard_normal(shape) for shape in ((200, 4), (200, 1), 200))
RESIDUAL = NOISE + J @ [1.0, -2.0, 0.5, 3.0] + E @ [0.3]


def least_squares(columns, r):
    """Return the sum of squares that columns leave, their amounts and sigmas."""
    amounts = np.linalg.lstsq(columns, r)[0]
    residual = r - columns @ amounts
    return residual @ residual, amounts, np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))


def test_amount_of_an_effect_is_that_of_the_fit_of_everything():
    test = ScoreTest(RESIDUAL, J)
    (e,) = test.independent(E).T
    chi2_without, _, _ = least_squares(J, RESIDUAL)
    chi2_with, amounts, sigmas = least_squares(np.hstack([J, E]), RESIDUAL)
    score, information = e @ test.residual, e @ e
    assert score**2 / information == pytest.approx(chi2_without - chi2_with)
    assert score / information == pytest.approx(amounts[4])
    assert information**-0.5 == pytest.approx(sigmas[4])


def test_refitted_columns_have_their_amounts():
    test = ScoreTest(RESIDUAL, np.column_stack([J, np.zeros(200)]))
    chi2, amounts, sigmas = least_squares(J, RESIDUAL)
    assert test.residual @ test.residual == pytest.approx(chi2)
    assert test.amounts == pytest.approx([*amounts, 0])
    assert test.sigmas == pytest.approx([*sigmas, np.inf])


def test_absorbed_effect_is_zero():
    effects = ScoreTest(RESIDUAL, J).independent(np.column_stack([J @ [1.0, 1.0, 0.0, 0.0], E[:, 0]]))
    assert not effects[:, 0].any() and effects[:, 1].all()
