"""The score test against a least-squares fit of everything together."""

import numpy as np
import pytest

from fit.consistency.score_test import ScoreTest

RNG = np.random.default_rng(3)
J, E, NOISE = (RNG.standard_normal(shape) for shape in ((200, 4), (200, 2), 200))
RESIDUAL = NOISE + J @ [1.0, -2.0, 0.5, 3.0] + E @ [0.3, -0.1]


def least_squares(columns, r):
    """Return the sum of squares that columns leave, their amounts and sigmas."""
    amounts = np.linalg.lstsq(columns, r)[0]
    residual = r - columns @ amounts
    return residual @ residual, amounts, np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))


def test_amounts_are_those_of_the_fit_of_everything():
    result = ScoreTest(RESIDUAL, J).test(E)
    chi2_without, _, _ = least_squares(J, RESIDUAL)
    chi2_with, amounts, sigmas = least_squares(np.hstack([J, E]), RESIDUAL)
    assert result.delta_chi2 == pytest.approx(chi2_without - chi2_with)
    assert result.amounts == pytest.approx(amounts[4:])
    assert result.sigmas == pytest.approx(sigmas[4:])


def test_known_effect_is_subtracted_with_amount_one():
    test = ScoreTest(RESIDUAL, J)
    result = test.test(E[:, 1:], E[:, 0])
    _, amounts, sigmas = least_squares(np.column_stack([J, E[:, 1]]), RESIDUAL - E[:, 0])
    assert result.amounts == pytest.approx(amounts[4:])
    assert result.sigmas == pytest.approx(sigmas[4:])


def test_refitted_columns_have_their_amounts():
    test = ScoreTest(RESIDUAL, np.column_stack([J, np.zeros(200)]))
    chi2, amounts, sigmas = least_squares(J, RESIDUAL)
    assert test.rank == 4
    assert test.chi2 == pytest.approx(chi2)
    assert test.refit.amounts == pytest.approx([*amounts, 0])
    assert test.refit.sigmas == pytest.approx([*sigmas, np.inf])


def test_absorbed_effect_has_no_amount():
    result = ScoreTest(RESIDUAL, J).test(np.column_stack([J @ [1.0, 1.0, 0.0, 0.0], E[:, 0]]))
    assert result.amounts[0] == 0
    assert np.isinf(result.sigmas[0])
    assert np.isfinite(result.sigmas[1])
