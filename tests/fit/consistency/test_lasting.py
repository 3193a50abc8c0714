"""What all runs have in common makes none of them contradict another, and is told all the same."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fit.consistency import lasting
from fit.fitting.joint_fit import fit_experiment, fit_joint
from fit.pipeline import calibrate
from fit.settings import settings
from fit.whitening.runs import pair
from tests.oracles import thirteen

NAMES = ("A2", "B4", "C4", "D4")
DURATION = 21600.0  # s
DRIFT = 2e-7  # s-2, from start to end


def softening(time, channels):
    """What a stiffness of test mass 2 that grows along the run adds, beyond that of mid-run."""
    x_2 = channels["o_1"] + channels["o_12"]
    nothing = np.zeros(time.size)
    return nothing, nothing, -DRIFT * np.clip(time / DURATION - 0.5, -0.5, 0.5) * x_2


@cache
def runs(hidden=None):
    return [
        thirteen.telemetry(thirteen.made(name, kind, seed=3), hidden=hidden if kind == "sysid" else None)
        for name in NAMES
        for kind in ("noise", "sysid")
    ]


def late(names, by):
    """Return clean runs, o_1 of some later by so many samples."""
    return [
        replace(r, channels=r.channels | {"o_1": np.roll(r.channels["o_1"], by)})
        if r.experiment in names
        else r
        for r in runs()
    ]


def bent(names, share, power=2):
    """Return clean runs, o_12 of some too large by a share of itself that is told at 10 nm."""
    return [
        replace(r, channels=r.channels | {"o_12": o * (1 + share * (o / 1e-8) ** power)})
        if r.experiment in names
        else r
        for r in runs()
        for o in (r.channels["o_12"],)
    ]


def jointly(found):
    experiments = pair(found)
    return experiments, fit_joint(experiments, settings())


def test_stiffness_that_drifts_in_all_runs_alike_is_told():
    joint = calibrate(runs(softening)).joint
    assert [w.code for w in joint.unsound] == ["structural_break"]
    assert re.match(r"omega2_2 changes by (1\.[6-9]|2\.[0-4]|2)e-07 ", joint.unsound[0].message)
    off = joint.parameters["omega2_1_0"]
    assert abs(off.value - thirteen.TRUTH["omega2_1_0"]) > 10 * off.sigma  # it passes for another stiffness


@pytest.mark.parametrize(("hidden", "drift"), [(None, 0.0), (softening, DRIFT)])
def test_drifts_have_true_amounts_and_sigmas(hidden, drift):
    experiments, outcome = jointly(runs(hidden))
    told = lasting.lasting(experiments, outcome)
    found, late = told.drifts, told.lags
    of = found["omega2_2"]
    assert abs(of.value - drift) < 4 * of.sigma
    assert 5e-9 < of.sigma < 3e-8
    if not drift:
        assert all(of.z < 4 for of in (*found.values(), *late.values()))

        assert lasting.in_common(experiments, outcome) == []


@pytest.mark.parametrize("by", [1, -1])
def test_o_1_that_is_late_in_all_runs_of_an_epoch_is_told(by):
    experiments, outcome = jointly(late(("B4", "C4", "D4"), by))
    found = lasting.lags(experiments, outcome)
    assert abs(found[4].value - by) < 0.1 * abs(by)  # to first order
    assert found[4].sigma < 0.1
    assert found[2].z < 4
    (warning,) = lasting.in_common(experiments, outcome)
    assert (warning.code, warning.parameters, warning.kind.unsound) == ("readout_lag", ("delta_ifo_4",), True)
    assert f"o_1 is {'late' if by > 0 else 'early'} by" in warning.message


def test_a_run_whose_o_1_is_late_is_left_out_by_name():
    joint = calibrate(late(("C4",), 3)).joint
    assert [w.message for w in joint.warnings if w.code == "rejected" and "o_1 is late by" in w.message]
    assert joint.unsound == ()
    of = joint.parameters["delta_ifo_4"]
    assert abs(of.value - thirteen.TRUTH["delta_ifo_4"]) < 4 * of.sigma


def test_a_run_by_itself_tells_its_lag():
    clean, spoilt = (next(e for e in pair(r) if e.name == "D4") for r in (runs(), late(("D4",), 1)))
    of_clean, of_spoilt = (fit_experiment(e, None, "gaussian") for e in (clean, spoilt))
    assert lasting.own_lag(clean, of_clean, 13) == ""
    assert lasting.own_lag(spoilt, of_spoilt, 13).startswith("o_1 is late by ")


def test_what_drifts_in_one_run_is_not_in_common():
    one = [b if b.experiment == "B4" else a for a, b in zip(runs(), runs(softening), strict=True)]
    experiments, outcome = jointly(one)
    of = lasting.lasting(experiments, outcome).drifts["omega2_2"]
    assert of.z > 5 > 3 > of.least
    assert not of.stands_out(len(lasting.DRIFTING))


def test_nothing_is_told_where_no_noise_is_known():
    results = calibrate(late(("D4",), 1), settings({"estimator": "flscov"}))
    assert results.joint.unsound == ()
    assert "consistency_untested" in {w.code for w in results.joint.warnings}


def test_a_read_out_that_is_bent_in_all_runs_is_told():
    share = 1e-3
    joint = calibrate(bent(NAMES, share)).joint
    (warning,) = [w for w in joint.unsound if w.code == "readout_nonlinearity"]
    value, _, sigma = re.search(r"too large by (\S+) (±) (\S+) of itself", warning.message).groups()
    assert abs(float(value) - share) < 0.2 * share  # levels of its own take some of it
    assert float(sigma) < 0.05 * share
    off = joint.parameters["omega2_2_0"]
    assert abs(off.value - thirteen.TRUTH["omega2_2_0"]) > 4 * off.sigma


def test_a_straight_read_out_is_not_told():
    for found in (runs(), bent(NAMES, 3e-5)):
        experiments, outcome = jointly(found)
        assert "readout_nonlinearity" not in {w.code for w in lasting.in_common(experiments, outcome)}
    experiments, outcome = jointly(runs())
    of = lasting.lasting(experiments, outcome).bend
    assert of.z < 4
    assert 5e-6 < of.sigma < 5e-5


def test_a_bend_has_its_true_amount():
    experiments, outcome = jointly(bent(NAMES, -2e-4))
    of = lasting.lasting(experiments, outcome).bend
    assert abs(of.value + 2e-4) < 4 * of.sigma
    assert of.z > lasting.BENT


def test_one_run_alone_or_another_harmonic_is_no_common_bend():
    for spoilt in (bent(("B4",), 1e-3), bent(NAMES, 1e-3, power=1)):
        experiments, outcome = jointly(spoilt)
        assert "readout_nonlinearity" not in {w.code for w in lasting.in_common(experiments, outcome)}
