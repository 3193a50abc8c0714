"""b_1 and b_2 told from the Euler force: by hand, and from rotating runs without and with inertial fit."""

import numpy as np
import pytest

from fit.crosstalk.crosstalk_fit import (
    INCLUDED,
    SEPARATED,
    is_separated,
    restore_euler_force,
    subtract_euler_force,
    subtraction_coefficients,
    with_euler_warning,
    without_euler,
)
from fit.crosstalk.inertial import separated
from fit.results import Fit, Results
from fit.results.estimates import Estimate
from fit.results.provenance import Provenance


def fit(values, sigmas, correlation=0.0):
    covariance = np.diag(np.square(sigmas))
    covariance[0, 1] = covariance[1, 0] = correlation * sigmas[0] * sigmas[1]
    parameters = {
        name: Estimate(value, sigma, "1") for (name, value), sigma in zip(values.items(), sigmas, strict=True)
    }
    return Fit(parameters, covariance, 1.0, 1, True, ())


MISALIGNED = fit({"delta_phi": -4e-4, "delta_eta": -1e-4}, [2e-5, 4e-6], 0.3)


def test_by_hand():
    sums = with_euler_warning(
        fit({"b_1": 1.2e-5 - 0.376 * 4e-4, "b_2": -0.9e-5 + 0.376 * 1e-4, "b_5": 1e-7}, [1e-7, 2e-7, 5e-9])
    )
    separated_fit = subtract_euler_force(sums, MISALIGNED, "3", 0.376)
    assert separated_fit.parameters["b_1"].value == pytest.approx(1.2e-5)
    assert separated_fit.parameters["b_2"].value == pytest.approx(-0.9e-5)
    assert separated_fit.parameters["b_5"] == sums.parameters["b_5"]
    assert separated_fit.parameters["b_1"].sigma == pytest.approx(np.hypot(1e-7, 0.376 * 2e-5))
    covariance = separated_fit.covariance_matrix[0, 1] / (0.376**2 * 2e-5 * 4e-6)
    assert covariance == pytest.approx(-0.3)
    assert is_separated(separated_fit)
    assert not is_separated(sums)
    assert [w.code for w in sums.warnings] == [INCLUDED]
    assert [w.code for w in separated_fit.warnings] == [SEPARATED]


def test_the_euler_force_of_another_fit_replaces_that_of_the_first():
    sums = with_euler_warning(fit({"b_1": 1e-5, "b_2": 2e-5, "b_5": 1e-7}, [1e-7, 2e-7, 5e-9], 0.5))
    without = subtract_euler_force(sums, MISALIGNED, "1", 0.376)
    restored = restore_euler_force(without, MISALIGNED, 0.376)
    assert restored.values == pytest.approx(sums.values)
    np.testing.assert_allclose(restored.covariance_matrix, sums.covariance_matrix, rtol=1e-9, atol=1e-24)
    assert restored.warnings == sums.warnings
    first = Results(None, {}, {"1": without}, {"1": MISALIGNED}, Provenance(cross_talk_periods={"1": "1"}))
    other = fit({"delta_phi": -2e-4, "delta_eta": 3e-4}, [1e-5, 2e-5])
    found, expected = separated(first, {"1": other})["1"], subtract_euler_force(sums, other, "1", 0.376)
    assert found.values == pytest.approx(expected.values)
    np.testing.assert_allclose(found.covariance_matrix, expected.covariance_matrix, rtol=1e-9, atol=1e-24)


def test_subtraction_coefficients_are_not_the_couplings():
    couplings = fit({"b_1": 1.2e-5 - 0.376 * 4e-4, "b_3": 2.2e-5}, [1e-7, 1e-7])
    coefficients = {"b_1": 1.1e-5 - 0.376 * 4e-4, "b_3": 1.8e-5}
    provenance = Provenance(cross_talk_periods={"1": "3"}, subtraction={"1": coefficients})
    joined = Results(None, {}, {"1": couplings}, {"3": MISALIGNED}, provenance)
    assert subtraction_coefficients(joined, "1") == without_euler(joined, "1") == coefficients
    assert subtraction_coefficients(joined, "2") == without_euler(joined, "2") == {}
    separated_results = Results(
        None,
        {},
        {"1": subtract_euler_force(couplings, MISALIGNED, "3", 0.376)},
        {"3": MISALIGNED},
        provenance,
    )
    assert subtraction_coefficients(separated_results, "1") == coefficients
    assert without_euler(separated_results, "1") == pytest.approx({"b_1": 1.1e-5, "b_3": 1.8e-5})
