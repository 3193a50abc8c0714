"""Constraints of an identification, against conditional Gaussian distributions of a run without any."""

import numpy as np
import pytest

from fit.settings import settings
from tests.fit.conditional import assert_conditional, conditional, row_of
from tests.fit.identification.linear_loop import CHOSEN, identified


def constrained(flight, constraints):
    return identified(flight, chosen=settings({**CHOSEN.record(), "parameters": constraints})).joint


def test_a_tie_and_a_prior(flown, unconstrained):
    free = unconstrained.joint
    ratio = free["omega2_1_0"].value / free["omega2_2_0"].value
    mean, sigma = free["lambda_2"].value + free["lambda_2"].sigma, free["lambda_2"].sigma
    tied = constrained(
        flown, {"omega2_1_0": {"expr": f"{ratio!r} * omega2_2_0"}, "lambda_2": {"prior": [mean, sigma]}}
    )
    row = row_of(free, omega2_1_0=1.0, omega2_2_0=-ratio)
    tied_estimate = conditional(free, row, 0.0)
    C = free.covariance_matrix
    gain = C @ row / (row @ C @ row)
    C = C - np.outer(gain, row @ C)
    prior = row_of(free, lambda_2=1.0)
    gain = C @ prior / (prior @ C @ prior + sigma**2)
    values = tied_estimate[0] + gain * (mean - prior @ tied_estimate[0])
    assert_conditional(tied, free, (values, np.sqrt(np.diag(C - np.outer(gain, prior @ C)))))
    assert tied["omega2_1_0"].value == pytest.approx(ratio * tied["omega2_2_0"].value, rel=1e-9)
    assert not tied.unsound


@pytest.mark.slow
def test_a_fixed_value_that_the_data_contradict_is_not_sound(flown, unconstrained):
    free = unconstrained.joint
    value = free["lambda_2"].value + 30 * free["lambda_2"].sigma
    fixed = constrained(flown, {"lambda_2": {"value": value, "vary": False}})
    contradiction = fixed.unsound[0]
    assert contradiction.code == "constraint_contradicted"
    # the comparison with the fit adds nothing to it
    assert not {w.code for w in fixed.warnings} & {"loop_contradiction", "loop_discrepancy"}
    assert {"lambda_2", "omega2_2_0"} <= set(contradiction.parameters)
    assert f"(without: {free['lambda_2'].value:.4g}"[:-1] in contradiction.message
