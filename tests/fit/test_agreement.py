"""Runs that contradict the others are left out by name, with the quantity and what may be wrong with it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fit.pipeline import calibrate
from tests.oracles import bump_synthetic
from tests.oracles.bump_synthetic import Motion
from tests.oracles.synthetic import World, pair

BOTH = ("sysid", "noise")
LATE = World(plateau=2e-15, tail=8e-15)


def campaign(seed=5, worlds=None, sets="ABCDE"):
    """Return the runs of five authorities that tell every parameter; `worlds` has those of other truth."""
    worlds = worlds or {}
    return [
        run
        for name in sets
        for run in pair(worlds.get(name, World()), name, seed=seed, drive_1=1e-12 * (name == "E"))
    ]


def replace_runs(name, fault, kinds=("sysid",)):
    return lambda runs: [fault(r) if r.experiment == name and r.kind in kinds else r for r in runs]


def channel(name, f):
    return lambda run: replace(run, channels=run.channels | {name: f(run.channels[name])})


def check_estimates(joint, but=()):
    for name, estimate in joint.parameters.items():
        if name not in but:
            assert abs(estimate.value - getattr(World(), name)) < 5 * estimate.sigma, name


def left_out(results):
    return [w.message for w in results.joint.warnings if w.code == "rejected"]


def test_outlier_is_left_out():
    results = calibrate(replace_runs("B", lambda r: replace(r, F_max_2=2.2e-9), BOTH)(campaign()))
    assert not results.joint.unsound
    check_estimates(results.joint)
    (message,) = left_out(results)
    assert re.match(r"left out of the joint fit: B: perhaps omega2_2 differs by 3\.[45]", message)
    assert results.experiments["B"].unsound
    agreement = results.provenance.extra["agreement"]
    assert set(agreement) == {"", "A", "B", "C", "D", "E"}
    assert agreement["B"] == {"p_outlier": pytest.approx(1.0, abs=0.01)}
    assert all(of_run["p"] > 1e-3 and of_run["dof"] > 0 for name, of_run in agreement.items() if name != "B")
    assert all(agreement[name]["p_outlier"] < 0.01 for name in "ACDE")


def test_weak_fault_of_all_runs_of_an_epoch_is_a_contradiction():
    # in none of its runs is it as much as 5 sigma
    scaled = channel("o_1", lambda o: 1.1 * o)
    scaled_runs = [
        scaled(r) for name in "BCD" for r in pair(World(), name, experiment=f"{name}2", epoch=2, seed=5)
    ]
    joint = calibrate([*campaign(), *scaled_runs]).joint
    assert [w.code for w in joint.unsound] == ["contradiction"]


@pytest.mark.parametrize(("samples", "delay"), [(5, "-4.827"), (-1, "1.17")])
def test_commands_late_or_early_in_every_run_leave_out_none(samples, delay):
    results = calibrate([channel("f_x_2", lambda f: np.roll(f, samples))(run) for run in campaign()])
    (warning,) = results.joint.unsound
    assert (warning.code, warning.parameters) == ("implausible_delay", ("C_2",))
    assert warning.message.startswith(f"f_x_2 acts {delay}")
    assert not left_out(results)
    assert "glitches" not in {w.code for w in results.joint.warnings}
    check_estimates(results.joint, but=("C_2",))


def test_counts_of_a_converter_cost_no_other_run_its_fit():
    # of which rounding leaves little
    results = calibrate(replace_runs("A", channel("o_12", lambda x: 3e13 * x))(campaign()))
    assert not results.joint.unsound
    check_estimates(results.joint)
    (message,) = left_out(results)
    assert "A-sysid.h5: unit, sign or scale of o_12" in message


def test_two_runs_that_disagree_are_both_doubtful():
    results = calibrate(campaign(worlds={"E": World(lambda_2=1.0884)}, sets="AE"))
    assert [w.code for w in results.joint.unsound] == ["contradiction"]


def test_attenuated_cross_talk_is_no_contradiction():
    # the noise of the inertial sensors attenuates b_3 ... b_6 of one epoch more in one run than in another
    noises = {"A": 1e-9, "B": 5e-9, "C": 1e-9}
    runs = [run for name, grs in noises.items() for run in bump_synthetic.pair(Motion(grs=grs), LATE, name)]
    results = calibrate(runs)
    assert {w.code for w in results.joint.warnings} == {
        "indeterminable",
        "high_leverage",
        "instrumental_variables",
    }
    assert results.provenance.extra["agreement"][""]["p"] > 1e-3
    scaled = calibrate(replace_runs("B1", channel("f_x_2", lambda f: 1.01 * f))(runs)).joint
    (message,) = (w.message for w in scaled.warnings if w.code == "rejected")
    assert message.startswith("left out of the joint fit: B1")
