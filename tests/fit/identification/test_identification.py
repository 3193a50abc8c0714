"""Parameters of a simulated loop, found again from telemetry of another simulation; no FMU takes part."""

from dataclasses import replace

import numpy as np
import pytest

from fit import pipeline
from fit.identification.loop import FreeParameter
from tests.fit.identification.linear_loop import CHOSEN, FREE, identified


def test_recovers_the_truth_as_the_equation_of_motion_does(flown, unconstrained):
    truth = {
        "lambda_2": 1.06,
        "C_2": 0.2,
        "omega2_1_0": -3.99e-7,
        "omega2_2_0": -4.6e-7,
        "delta_ifo_1": -2.2e-5,
    }
    assert set(unconstrained.joint) == set(truth)
    for name, value in truth.items():
        assert abs(unconstrained.joint[name].value - value) < 4 * unconstrained.joint[name].sigma
    experiment_fit = flown[2].experiments["A"]
    stiffness = -317 * 2200e-12 - 27.4e3 * 10.4e-12  # of the authority
    counterparts = {"lambda_2": ("lambda_2", 0), "C_2": ("C_2", 0), "omega2_2_0": ("omega2_2", stiffness)}
    for name, (theirs, offset) in counterparts.items():
        assert (
            abs(unconstrained.joint[name].value + offset - experiment_fit[theirs].value)
            < 0.05 * experiment_fit[theirs].sigma
        )
        assert unconstrained.joint[name].sigma == pytest.approx(experiment_fit[theirs].sigma, rel=0.02)
    assert unconstrained.joint.chi2 / unconstrained.joint.dof == pytest.approx(
        experiment_fit.chi2 / experiment_fit.dof, rel=1e-3
    )
    assert (
        unconstrained.joint.dof == experiment_fit.dof - 2
    )  # two poles of the controller, whose first state is not known
    assert not unconstrained.joint.unsound


@pytest.mark.slow
def test_a_wrong_controller_is_seen_in_the_difference_from_the_fit_and_not_in_chi2(flown, unconstrained):
    fit = identified(flown, unity_gain=1.0005e-3).joint
    assert fit.chi2 == pytest.approx(unconstrained.joint.chi2, rel=1e-3)
    assert abs(fit["lambda_2"].value - unconstrained.joint["lambda_2"].value) > 3 * fit["lambda_2"].sigma
    (contradiction,) = [w for w in fit.unsound if w.code == "loop_contradiction"]
    assert "lambda_2" in contradiction.parameters
    simulated = identified(flown, unity_gain=1.0005e-3, simulated=True).joint
    assert "loop_discrepancy" in {w.code for w in simulated.warnings}
    assert not simulated.unsound  # the telemetry says that this very loop simulated it


def test_gain_of_the_controller_and_of_the_actuation_are_one_number_to_the_read_out(flown):
    fit = identified(flown, (*FREE, FreeParameter("Controller.f_u", 1e-3, 1e-4))).joint
    (blind,) = [w for w in fit.warnings if w.code == "indeterminable"]
    assert {"lambda_2", "Controller.f_u"} <= set(blind.parameters) <= {"lambda_2", "C_2", "Controller.f_u"}
    assert "depend only on their combination" in blind.message
    assert {"omega2_2_0", "delta_ifo_1"} <= set(fit)


@pytest.mark.slow
def test_a_pole_of_the_controller_is_found_wherever_the_search_begins(flown):
    free = (FreeParameter("C_2", bounds=(0.06, 10.0)), *(p for p in FREE if p.name != "C_2"))
    fit, second_fit = (
        identified(flown, (*free, FreeParameter("Controller.f_p", p, 6e-3))).joint for p in (6.6e-3, 0.012)
    )
    pole = fit["Controller.f_p"]
    for name, estimate in fit.parameters.items():
        assert abs(second_fit[name].value - estimate.value) < 0.04 * estimate.sigma
        assert second_fit[name].sigma == pytest.approx(estimate.sigma, rel=0.01)
    assert abs(pole.value - 6e-3) < 4 * pole.sigma < 0.02 * 6e-3


@pytest.mark.slow
@pytest.mark.parametrize("sigmas", [0.5, 30.0])
def test_a_bound_is_contradicted_where_noise_does_not_explain_it(flown, unconstrained, sigmas):
    estimate = unconstrained.joint["lambda_2"]
    bound = estimate.value + sigmas * estimate.sigma
    bounded = identified(flown, (FreeParameter("lambda_2", bounds=(bound, 1.2)), *FREE[1:])).joint
    assert bounded["lambda_2"].value == pytest.approx(bound, abs=1e-3 * estimate.sigma)
    (at_bound,) = [w for w in bounded.warnings if w.code == "at_bound"]
    assert at_bound.parameters == ("lambda_2",)
    contradicted = [w for w in bounded.warnings if w.code == "constraint_contradicted"]
    assert len(contradicted) == (sigmas == 30) == bool(bounded.unsound)
    for warning in contradicted:
        assert {"lambda_2", "omega2_2_0"} <= set(warning.parameters)


def changed(flown, **channels):
    """Return the same flight with something added to channels of its sysid run, and its calibration."""
    runs, (sysid, noise), _ = flown
    mixed = {name: sysid.channels[name] + x for name, x in channels.items()}
    telemetries = [replace(sysid, channels={**sysid.channels, **mixed}), noise]
    return runs, telemetries, pipeline.calibrate(telemetries, CHOSEN)


def agree(fit, flight):
    """Return whether parameters and sigmas are those of the fit of the same telemetry."""
    experiment_fit = flight[2].experiments["A"]
    for name, theirs in (("lambda_2", "lambda_2"), ("C_2", "C_2")):
        assert abs(fit[name].value - experiment_fit[theirs].value) < 0.05 * experiment_fit[theirs].sigma
        # what the controller began with is taken out here
        assert fit[name].sigma == pytest.approx(experiment_fit[theirs].sigma, rel=0.005)


@pytest.mark.slow
def test_noise_of_the_read_out_of_test_mass_1_is_no_motion(flown):
    n = flown[1][0].time.size
    flight = changed(flown, o_1=6e-9 * np.random.default_rng(2).standard_normal(n))
    joint_fit = identified(flight).joint
    assert "readout_excess_noise" in {w.code for w in joint_fit.warnings}
    assert {"lambda_2", "C_2", "omega2_2_0"} <= set(joint_fit)
    agree(joint_fit, flight)
