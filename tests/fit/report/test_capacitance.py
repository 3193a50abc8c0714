"""The stiffness that the geometry predicts."""

import numpy as np
import pytest

from fit import parameters
from fit.parameters import alpha_phi, alpha_x, background
from fit.report.stiffness import predictions
from fit.results.estimates import Estimate
from fit.results.results import Fit


def joint(**values):
    parameters = {name: Estimate(value, sigma, "") for name, (value, sigma) in values.items()}
    return Fit(parameters, np.eye(len(values)), 1.0, 1, True, ())


def test_the_capacitances_give_what_the_paper_predicts():
    gain, _ = parameters.LAMBDA_V
    assert alpha_x(gain) == pytest.approx(-320, rel=0.01)  # "around" in the paper, two digits
    assert alpha_phi(gain) == pytest.approx(-26.5e3, rel=0.01)


def test_alpha_x_is_the_gradient_of_the_actuation_force():
    # Two electrodes on either side of the test mass at constant V_plus^2 + V_minus^2. C grows with x on the
    # plus side and falls on the minus side; energy (C_plus V_plus^2 + C_minus V_minus^2) / 2, twice.
    def force(x, plus, minus, h=1e-6):
        def energy(at):
            C = [s * parameters.DC_DX * at + parameters.D2C_DX2 * at**2 / 2 for s in (1, -1)]
            return C[0] * plus + C[1] * minus

        return (energy(x + h) - energy(x - h)) / (2 * h)

    V2 = 9.0
    F_max = force(0.0, V2, 0.0)
    gradient = [(force(1e-6, *V) - force(-1e-6, *V)) / 2e-6 for V in ((V2, 0.0), (V2 / 3, 2 * V2 / 3))]
    assert gradient[0] == pytest.approx(gradient[1])  # constant, whatever force is commanded
    assert -gradient[0] / parameters.M_TM / F_max == pytest.approx(alpha_x(1.0), rel=1e-6)


def test_the_potential_of_the_test_mass_weakens_alpha_phi():
    # without it, both are the same gradient per unit of what the same voltages can do
    alone = alpha_x(1.0) * parameters.DC_DX / parameters.DC_DPHI
    assert 0.9 * alone > alpha_phi(1.0) > alone


def test_a_fitted_coefficient_tells_the_gain_of_the_voltage():
    fitted = joint(alpha_x_2=(alpha_x(1.1), abs(alpha_x(1.1)) * 0.02), alpha_phi_1=(alpha_phi(1.066), 1.0))
    force, torque = predictions(fitted)
    assert (force.name, torque.name) == ("alpha_x_2", "alpha_phi_1")
    assert (force.lambda_V.value, force.lambda_V.sigma) == pytest.approx((1.1, 0.011))
    assert force.excess == pytest.approx((1.1 / 1.066) ** 2 - 1)
    assert torque.excess == pytest.approx(0)
    # alpha goes with the square
    assert force.sigma == pytest.approx((alpha_x(1.064) - alpha_x(1.068)) / 2, rel=1e-3)


def test_a_positive_coefficient_has_no_voltage():
    (force,) = predictions(joint(alpha_x_1=(20.0, 9.0)))
    assert force.lambda_V is None
    assert predictions(joint(C_2=(0.2, 0.1))) == []


def test_the_budget_adds_up_to_the_paper_s():
    assert background() == pytest.approx((-4.17e-7, -4.27e-7))
    assert [round(1e7 * total, 1) for total in background()] == [-4.2, -4.3]
