"""Coefficients that change within runs: seen slow or sudden, in one run or in all, and nowhere else."""

from types import SimpleNamespace

import numpy as np
import pytest

from fit.checks import drift as drifts
from fit.fitting.experiment_and_joint_fit import fit_experiment, fit_joint
from fit.pipeline import calibrate
from fit.settings import settings
from fit.whitening import pair
from tests.fit.checks.campaigns import campaign as campaign_of
from tests.hostile.spoiling import changed, clean, every, late
from tests.oracles import thirteen
from tests.oracles.thirteen import TRUTH

NAMES = ("A1", "B4", "C4", "D4")


def varied(departure):
    """Return a function that multiplies the changes of a channel by a gain that departs from one."""
    return lambda x: x + departure(np.arange(x.size), x.size) * (x - x.mean())


def wave(period, size, phase=0.0):
    return varied(lambda n, _: size * np.sin(2 * np.pi * n / period + phase))


def step(size, at):
    return varied(lambda n, _: size * (n >= at))


def drift_of(spoil):
    """Return what changes in B4 by its own fit, and the campaign it is in."""
    (e,) = pair(list(spoil(clean(("B4",))).values()))
    fit = fit_experiment(e)
    (block,) = fit.whitened_runs[0].blocks
    periods = drifts.wave_periods([block])
    return drifts.find_drift([drifts.waves(block, fit.solution.theta, periods)], periods, 1e-5)


@pytest.mark.parametrize(
    "spoil",
    [
        changed("B4-sysid", f_x_2=varied(lambda n, size: 5e-3 * n / size)),
        changed("B4-sysid", f_x_2=wave(10800, 2e-3)),
        changed("B4-sysid", f_x_2=step(3e-3, 9000)),
        changed("B4-sysid", o_12=wave(18000, 1e-3)),
        changed("B4-sysid", f_x_2=lambda x: np.where(np.arange(x.size) < 9000, x, late(x, 0.1))),
    ],
    ids=["slope", "wave", "step", "read-out", "delay"],
)
def test_a_coefficient_that_changes_is_seen(spoil):
    (found,) = drift_of(spoil)
    assert found.column in ("ddo_12", "f_2", "df_2")


@pytest.mark.parametrize("seed", [1, 2])
def test_constant_coefficients_do_not_change(seed):
    # 2.3e-4 each for the runs and for all of them together
    runs = [
        thirteen.telemetry(thirteen.made(name, kind, seed)) for name in NAMES for kind in ("sysid", "noise")
    ]
    experiments = pair(runs)
    assert drifts.find(campaign_of(experiments).fit_each()) == []
    assert drifts.find_joint(SimpleNamespace(outcome=fit_joint(experiments, settings()))) == []


def test_the_experiment_that_drifts_is_left_out():
    results = calibrate(list(changed("B4-sysid", f_x_2=step(3e-3, 9000))(clean(NAMES)).values()))
    assert results.provenance.joint_runs == ["A1-sysid", "C4-sysid", "D4-sysid"]
    assert not results.joint.unsound
    (message,) = (w.message for w in results.joint.warnings if w.code == "rejected")
    assert "changes by" in message
    for name, estimate in results.joint.parameters.items():
        assert abs(estimate.value - TRUTH[name]) < 4.5 * estimate.sigma


@pytest.mark.parametrize(
    ("period", "size", "code"),
    [
        (3600.0, 4e-4, "drift"),
        (9000.0, 4e-4, "drift"),
        (18000.0, 7e-4, "drift"),
        (40000.0, 7e-4, "contradiction"),
    ],
)
def test_a_gain_that_follows_the_temperature_in_all_runs_is_not_sound(period, size, code):
    """Each run has a phase of its own; half of the size moves no estimate by five sigma."""
    phases = dict(zip((f"{name}-sysid" for name in NAMES), (0.3, 2.0, 4.1, 5.5), strict=True))
    runs = every(lambda run: changed(run, o_12=wave(period, size, phases[run])), NAMES)(clean(NAMES))
    joint = calibrate(list(runs.values())).joint
    assert code in {w.code for w in joint.unsound}


def test_scatter_between_runs_is_no_drift():
    gains = {"A1": 1.002, "B4": 0.998, "C4": 1.001, "D4": 0.999}
    spoil = every(lambda run: changed(run, f_x_2=lambda x: gains[run.split("-")[0]] * x), NAMES)
    joint = calibrate(list(spoil(clean(NAMES)).values())).joint
    assert "drift" not in [w.code for w in joint.warnings]
