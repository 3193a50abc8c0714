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
    left = r - columns @ amounts
    return left @ left, amounts, np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))


def test_it_is_the_fit_of_everything_together():
    result = ScoreTest(RESIDUAL, J).test(E)
    before, _, _ = least_squares(J, RESIDUAL)
    after, amounts, sigmas = least_squares(np.hstack([J, E]), RESIDUAL)
    assert result.delta_chi2 == pytest.approx(before - after)
    assert result.amounts == pytest.approx(amounts[4:])
    assert result.sigmas == pytest.approx(sigmas[4:])


def test_sums_over_runs_are_the_fit_of_all_runs():
    """Columns of each run are refitted, the amounts are common to both."""
    parts = [(RESIDUAL[at], J[at], E[at]) for at in (slice(0, 80), slice(80, 200))]
    first, second = (ScoreTest(r, j).sums(e) for r, j, e in parts)
    columns = np.zeros((200, 10))
    columns[:80, :4], columns[80:, 4:8], columns[:, 8:] = J[:80], J[80:], E
    _, amounts, sigmas = least_squares(columns, RESIDUAL)
    result = (first + second).result()
    assert result.amounts == pytest.approx(amounts[8:])
    assert result.sigmas == pytest.approx(sigmas[8:])


def test_an_exact_effect_has_the_amount_one():
    test = ScoreTest(RESIDUAL, J)
    before, _, _ = least_squares(J, RESIDUAL)
    after, _, _ = least_squares(J, RESIDUAL - E[:, 0])
    assert test.test_exact(E[:, 0]) == pytest.approx(before - after)


def test_what_the_refitted_columns_absorb_has_no_amount():
    result = ScoreTest(RESIDUAL, J).test(np.column_stack([J @ [1.0, 1.0, 0.0, 0.0], E[:, 0]]))
    assert result.amounts[0] == 0
    assert np.isinf(result.sigmas[0])
    assert np.isfinite(result.sigmas[1])
