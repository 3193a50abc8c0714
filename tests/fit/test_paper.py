import doctest

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit import units
from fit.parameters import (
    FLIGHT,
    experiment_parameters,
    joint_parameter,
    stiffness,
)

NOMINAL = ((0.0, 10.4e-12), (2200e-12, 10.4e-12))


def test_flight_values_are_those_of_table_jointfit():
    # Typed again from the paper's table, in its own units.
    table = {
        "lambda_1": (1.0748, 0.0001),
        "lambda_2": (1.0776, 0.0001),
        "omega2_1_0": (-3.99 * 1e-7, 0.07 * 1e-7),
        "omega2_2_0": (-4.19 * 1e-7, 0.04 * 1e-7),
        "C_1": (0.149, 0.004),
        "C_2": (0.186, 0.004),
        "alpha_x_1": (-345, 9),
        "alpha_phi_1": (-28.2 * 1e3, 0.9 * 1e3),
        "alpha_x_2": (-317, 6),
        "alpha_phi_2": (-27.4 * 1e3, 0.8 * 1e3),
        "delta_ifo_1": (-2.2 * 1e-5, 0.2 * 1e-5),
        "delta_ifo_2": (-1.40 * 1e-5, 0.06 * 1e-5),
        "delta_ifo_3": (-2.09 * 1e-5, 0.06 * 1e-5),
        "delta_ifo_4": (1.91 * 1e-5, 0.08 * 1e-5),
    }
    assert FLIGHT.keys() == table.keys()
    for name, (value, sigma) in table.items():
        assert FLIGHT[name].name == name
        assert FLIGHT[name].value == pytest.approx(value, rel=1e-12, abs=0)
        assert FLIGHT[name].sigma == pytest.approx(sigma, rel=1e-12, abs=0)
        assert FLIGHT[name].flown


def test_weak_priors_have_the_widths_of_the_contract():
    assert FLIGHT["lambda_1"].prior_sigma == pytest.approx(0.10748)
    assert FLIGHT["C_1"].prior_sigma == 0.3
    assert FLIGHT["omega2_1_0"].prior_sigma == pytest.approx(3.99e-7)
    assert FLIGHT["alpha_phi_2"].prior_sigma == pytest.approx(27.4e3)
    assert FLIGHT["delta_ifo_4"].prior_sigma == pytest.approx(1.91e-5)


def test_an_epoch_the_flight_did_not_have_takes_the_rms():
    parameter = joint_parameter("delta_ifo_7")
    assert parameter.value == pytest.approx(((2.2**2 + 1.4**2 + 2.09**2 + 1.91**2) / 4) ** 0.5 * 1e-5)
    assert not parameter.flown


def test_experiment_parameters_at_nominal_authority():
    # By hand: -4.19e-7 - 317*2.2e-9 - 27.4e3*10.4e-12 and -3.99e-7 - 28.2e3*10.4e-12.
    found = experiment_parameters(NOMINAL, epoch=4)
    omega2_2, domega2_12 = found["omega2_2"], found["domega2_12"]
    assert omega2_2.value == pytest.approx(-1.40136e-6, rel=1e-12)
    assert domega2_12.value == pytest.approx(-1.40136e-6 + 6.9228e-7, rel=1e-12)
    assert domega2_12.sigma > omega2_2.sigma > FLIGHT["omega2_2_0"].sigma
    assert domega2_12.prior_sigma == omega2_2.prior_sigma == pytest.approx(1.40136e-6)
    assert found["delta_ifo"].value == 1.91e-5
    names = ("lambda_2", "C_2", "omega2_2", "domega2_12", "delta_ifo", "lambda_1", "C_1")
    assert tuple(found) == names == tuple(p.name for p in found.values())


@given(st.floats(0, 5e-9), st.floats(0, 5e-9), st.floats(0, 2e-11))
def test_stiffness_is_linear_in_the_authority(a, b, N_max):
    values = {name: p.value for name, p in FLIGHT.items()}
    mean = (stiffness(2, values, a, N_max) + stiffness(2, values, b, N_max)) / 2
    assert stiffness(2, values, (a + b) / 2, N_max) == pytest.approx(mean, rel=1e-12, abs=0)
    assert stiffness(1, values, 0, 0) == values["omega2_1_0"]


def test_doctests():
    assert doctest.testmod(units).failed == 0
