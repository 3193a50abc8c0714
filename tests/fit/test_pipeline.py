"""Calibrations: on synthetic telemetry, then end to end on the reference plant."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fit import campaign as campaign_module
from fit.errors import FitError, InputError
from fit.fitting import fit_experiment
from fit.model import Sharing, dynamics
from fit.parameters import joint_names
from fit.pipeline import calibrate
from fit.settings import settings
from lpfcosim.campaign import loading
from lpfcosim.models import one_axis
from tests.fit.recorded import recorded
from tests.oracles.synthetic import World, of_run, pair, telemetry, without
from tests.reference_run import simulate_reference

SETS = (("A", 1), ("B", 1), ("C", 2), ("D", 2))
ALIKE = SETS[:2]  # in N_max
SHARING = Sharing(settings().shared)
FREE = ["lambda_2", "C_2", "omega2_1_0", "omega2_2_0", "alpha_phi_1", "alpha_x_2", "alpha_phi_2"]
OFF = World(
    lambda_2=1.0776 * 0.95,
    C_2=0.186 * 1.3,
    omega2_1_0=-3.99e-7 * 0.7,
    omega2_2_0=-4.19e-7 * 1.3,
    alpha_phi_1=-28.2e3 * 1.3,
    alpha_x_2=-317 * 0.7,
    alpha_phi_2=-27.4e3 * 0.75,
)


def campaign_of(world, sets=SETS, **options):
    return [run for authority, epoch in sets for run in pair(world, authority, epoch=epoch, **options)]


@cache
def calibrated(sets=SETS, **options):
    """Return the calibration of a campaign far from the flight, made once for all tests."""
    return calibrate(campaign_of(OFF, sets, **options))


def pulls(fit, truth):
    return {name: (e.value - truth[name]) / e.sigma for name, e in fit.parameters.items()}


def largest_pull(fit):
    return max(abs(p) for p in pulls(fit, vars(OFF)).values())


def indeterminable(fit):
    return [w for w in fit.warnings if w.code == "indeterminable"]


def test_recovers_truth_far_from_flight():
    sets = (*SETS, ("E", 2))  # which drives test mass 1
    results = calibrated(sets, drive_1=1e-12)
    joint = results.joint
    assert list(joint.parameters) == list(joint_names([1, 2]))
    assert not indeterminable(joint)
    assert largest_pull(joint) < 4.5
    for (authority, epoch), fit in zip(sets, results.experiments.values(), strict=True):
        assert max(abs(p) for p in pulls(fit, of_run(OFF, authority, epoch)).values()) < 4.5
    assert joint.chi2 / joint.dof == pytest.approx(1, abs=0.1)
    sigma = np.sqrt(np.diag(joint.covariance_matrix))
    assert sigma == pytest.approx([e.sigma for e in joint.parameters.values()], rel=1e-6, abs=0)
    assert np.linalg.eigvalsh(joint.covariance_matrix / np.outer(sigma, sigma)).min() > 0


def test_order_of_the_files_does_not_matter():
    forth, back = calibrated().joint, calibrate(campaign_of(OFF)[::-1]).joint
    for name, estimate in forth.parameters.items():
        assert back.parameters[name].value == pytest.approx(estimate.value, abs=1e-3 * estimate.sigma)
        assert back.parameters[name].sigma == pytest.approx(estimate.sigma, rel=1e-3)


@pytest.mark.parametrize(
    ("sets", "together", "reason"),
    [
        (ALIKE, {"omega2_2_0", "alpha_phi_2"}, "N_max_2 is the same"),
        (ALIKE, {"omega2_1_0", "alpha_phi_1"}, "N_max_1 is the same"),
        (SETS, {"alpha_x_1"}, "F_max_1 is the same"),
        (SETS, {"lambda_1"}, "no run drives test mass 1"),
    ],
)
def test_blind_directions_are_named(sets, together, reason):
    joint = calibrated(sets).joint
    (warning,) = (w for w in indeterminable(joint) if set(w.parameters) == together)
    assert reason in warning.message
    assert set(warning.combination) == together
    assert not together & joint.parameters.keys()
    # moving along the combination changes no stiffness of any run
    names = joint_names([epoch for _, epoch in sets])
    along = np.array([warning.combination.get(name, 0.0) for name in names])
    for authority, epoch in sets:
        share = SHARING.matrix(telemetry(OFF, authority, epoch=epoch), dynamics.PARAMETERS, names)[4:]
        assert np.all(np.abs(share @ along) <= 1e-6 * np.abs(share) @ np.abs(along))


def test_what_is_blind_biases_nothing_else():
    # All N_max alike: alpha_x_2 still comes out, though omega2_2_0 and alpha_phi_2 are far from flight.
    joint = calibrated(ALIKE).joint
    assert {"lambda_2", "C_2", "alpha_x_2", "delta_ifo_1"} == joint.parameters.keys()
    assert largest_pull(joint) < 4.5


def test_short_runs_of_another_rate_take_part_only_when_asked():
    runs = campaign_of(OFF, ALIKE) + pair(OFF, "D", epoch=2, duration=7200.0, fs=4.0)
    without_short, with_short = calibrate(runs), calibrate(runs, settings({"include_short": True}))
    assert without_short.provenance.joint_runs == ["A-sysid", "B-sysid"]
    for fit in (without_short.joint, without_short.experiments["D"]):
        (warning,) = (w for w in fit.warnings if w.code == "short_run")
        assert "D-sysid" in warning.message
    assert with_short.provenance.joint_runs == ["A-sysid", "B-sysid", "D-sysid"]
    assert with_short.joint.parameters["lambda_2"].sigma < without_short.joint.parameters["lambda_2"].sigma
    assert largest_pull(with_short.joint) < 4.5


def mismatched(**changes):
    run, noise = pair(World())
    return [run, replace(noise, **changes)]


SCATTERED = tuple((start, start + 2) for start in range(50, 21500, 120))


@pytest.mark.parametrize(
    ("runs", "message"),
    [
        ([], r"^no telemetry: no run of kind 'sysid'"),
        (mismatched()[1:], r"^A-noise\.h5: no run of kind 'sysid'"),
        (mismatched(N_max_1=1e-12), r"^A-noise\.h5: attribute N_max_1: 1e-12, expected 1\.04e-11 as in"),
        (pair(World(), duration=1200.0), r"^A-sysid\.h5: lasts 1200 s, expected at least 1800 s"),
        (mismatched(kind="sysid"), r"^A-noise\.h5: experiment 'A' already has the sysid run A-sysid\.h5"),
        (
            [without(mismatched()[0], *SCATTERED)],
            r"^A-sysid\.h5: missing and masked samples lie so widely",
        ),
    ],
)
def test_bad_input_is_one_sentence_that_names_the_file(runs, message):
    with pytest.raises(InputError, match=message) as caught:
        calibrate(runs)
    assert "\n" not in str(caught.value)


FACTORS = {"lambda_2": 1.04, "C_2": 0.75, "omega2_1_0": 1.2, "omega2_2_0": 0.8}


def test_bias_on_the_reference_plant_is_far_below_sigma(quickstart):
    plan = loading.load(quickstart)
    truth = {
        name: value * FACTORS.get(name, 1.3 if name.startswith("delta_ifo") else 1.0)
        for name, value in plan.truth.items()
    }
    runs = replace(plan, truth=truth).runs
    quiet = [replace(run, noise={}) if run.kind == "sysid" else run for run in runs]
    joint = calibrate([recorded(run, simulate_reference(run)) for run in quiet]).joint
    assert list(joint.parameters) == [*FREE, "delta_ifo_1", "delta_ifo_2"]
    expected = one_axis.MODEL.stated_truth | truth
    assert max(abs(p) for p in pulls(joint, expected).values()) < 1e-3


def test_a_run_that_cannot_be_prepared_costs_the_others_nothing():
    good = campaign_of(OFF, ALIKE)
    # gaps so close that the stencils leave nothing between them
    gaps = [(i, i + 2) for i in range(20, 3600, 60)]
    bad = [without(r, *gaps) for r in pair(World(), "D", duration=3600.0)]
    with_bad = calibrate([*good, *bad], settings({"include_short": True}))
    assert with_bad.joint.values == calibrated(ALIKE).joint.values
    assert not with_bad.joint.unsound
    (message,) = (w.message for w in with_bad.joint.warnings if w.code == "rejected")
    assert message.startswith("left out of the joint fit: D-sysid.h5: ")
    with pytest.raises(InputError, match=r"D-sysid\.h5: .* masking leaves less"):
        calibrate(bad, settings({"include_short": True}))


def test_an_experiment_may_be_left_out():
    results = calibrate(campaign_of(OFF, ALIKE), settings({"exclude": ["B"]}))
    assert results.provenance.joint_runs == ["A-sysid"]
    assert "excluded" in {w.code for w in results.experiments["B"].warnings}
    with pytest.raises(InputError, match="no experiment 'Z', there are A, B"):
        calibrate(campaign_of(OFF, ALIKE), settings({"exclude": ["Z"]}))


def test_what_one_experiment_cannot_yield_does_not_cost_the_joint_fit(monkeypatch):
    def fails(experiment, *_):
        if experiment.name == "B":
            raise FitError("B: it does not settle")
        return fit_experiment(experiment, *_)

    monkeypatch.setattr(campaign_module, "fit_experiment", fails)
    runs = campaign_of(OFF, SETS[:3])
    results = calibrate(runs)
    assert list(results.experiments) == ["A", "C"]
    (warning,) = (w for w in results.joint.warnings if w.code == "no_single_fit")
    assert warning.message == "B: it does not settle"
    with pytest.raises(FitError, match=r"^B: it does not settle$"):
        calibrate(runs[2:4], settings({"exclude": ["B"]}))
    without_joint = calibrate(runs, settings({"exclude": ["A", "B", "C"]}))
    assert without_joint.joint is None
    assert list(without_joint.experiments) == ["A", "C"]
    for fit in without_joint.experiments.values():
        assert "B: it does not settle" in {w.message for w in fit.warnings if w.code == "no_single_fit"}
