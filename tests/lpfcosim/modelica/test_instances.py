"""Instances of built FMUs: what may be set."""

from contextlib import ExitStack

import numpy as np
import pytest

from tests.lpfcosim.modelica.fmu_instance import fmu_instance

pytestmark = pytest.mark.fmu


@pytest.fixture
def instantiate():
    """Make initialised slaves; freed at the end."""
    with ExitStack() as stack:

        def make(archive, **values):
            instance = stack.enter_context(fmu_instance(archive, **values))
            instance.exitInitializationMode()
            return instance

        yield make


def drive(plant, n, first=0):
    out = []
    for i in range(first, first + n):
        plant.set(["F_x_sc", "f_applied_2"], [1e-7 * np.sin(i), 1e-12 * np.cos(0.3 * i)])
        plant.doStep(i * 0.1, 0.1)
        out.append(tuple(plant.get(["x_1", "x_2"])))
    return out


def test_outputs_follow_the_inputs_without_a_step(fmus, instantiate):
    metrology = instantiate(fmus["OpticalMetrology"])
    for value in (1e-9, 2e-9):
        metrology.set(["x_1"], [value])
        assert metrology.get(["o_1"]) == [value]


def test_calculated_parameters_follow_what_is_set(fmus, instantiate):
    plant = instantiate(
        fmus["Plant"], F_max_1=1e-9, N_max_1=5e-12, omega2_1_0=-1e-7, alpha_x_1=-300, alpha_phi_1=-2e4
    )
    assert plant.get(["testMass_1.omega2"])[0] == pytest.approx(-1e-7 - 300 * 1e-9 - 2e4 * 5e-12, rel=1e-15)


def test_reset_starts_anew_and_instances_do_not_touch_each_other(fmus, instantiate):
    one, two = instantiate(fmus["Plant"]), instantiate(fmus["Plant"], m_sc=100.0)
    alone = drive(one, 40)
    one.reset()
    one.enterInitializationMode()
    one.exitInitializationMode()
    mixed = []
    for i in range(40):
        mixed += drive(one, 1, first=i)
        drive(two, 1, first=i)
    assert mixed == alone
    assert drive(two, 1, first=40) != drive(one, 1, first=40)
