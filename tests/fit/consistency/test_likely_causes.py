"""Faults put into telemetry of the synthetic oracle are named, though others look nearly the same."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import interpolate, signal

from fit.consistency.likely_causes import rank_causes
from fit.consistency.run_test import RunTest
from fit.fitting.experiment_and_joint_fit import fit_joint
from fit.model.sharing import Sharing
from fit.settings import settings
from fit.whitening import pair as paired
from tests.oracles.synthetic import World, pair

N = 21600


@cache
def campaign():
    """Return the runs of two experiments, their joint fit, and the runs of a third one."""
    runs = [*pair(World(), "A", seed=1), *pair(World(), "E", seed=2, drive_1=1e-12)]
    experiments = paired(runs)
    return experiments, fit_joint(experiments, settings()), pair(World(), "B", seed=3, drive_1=5e-13)


def causes(**channels):
    """Return kinds and words where channels of the third experiment are functions of all of them."""
    experiments, joint, (sysid, noise) = campaign()
    old = sysid.channels
    new = {name: np.asarray(function(old), dtype=float) for name, function in channels.items()}
    (faulty,) = paired([replace(sysid, channels=old | new), noise])
    test = RunTest(faulty, joint, experiments, Sharing(settings().shared))
    return [(cause.kind, cause.words) for cause in rank_causes(test, [faulty])]


def late(x, samples):
    n = np.arange(x.size)
    return interpolate.CubicSpline(n, x)(np.clip(n - samples, 0, n[-1]))


def switched(begin, x, y):
    return np.where(np.arange(x.size) < begin, x, y)


def test_run_that_agrees_has_no_cause():
    assert causes() == []


def test_lag_is_no_low_pass_and_no_sign():
    assert causes(o_12=lambda c: late(c["o_12"], 1)) == [("lag", "o_12 is late by 1 sample")]


def test_exchanged_commands_are_no_wrong_sign():
    exchanged = causes(f_x_1=lambda c: c["f_x_2"], f_x_2=lambda c: c["f_x_1"])
    assert exchanged == [("exchange", "f_x_1 and f_x_2 are exchanged")]


FAULTS = {
    "nm": ({"o_12": lambda c: 1e9 * c["o_12"]}, {"unit"}, "o_12 is in nm"),
    "sign": ({"f_x_1": lambda c: -c["f_x_1"]}, {"sign"}, "f_x_1 has the wrong sign"),
    "late and wrong sign": (
        {"f_x_2": lambda c: -late(c["f_x_2"], 3)},
        {"lag and scale"},
        "f_x_2 is late by 3 samples, and f_x_2 has the wrong sign",
    ),
    "low-pass": (
        {"f_x_2": lambda c: signal.lfilter([1 - 1 / np.e], [1, -1 / np.e], c["f_x_2"])},
        {"filter"},
        "f_x_2 was filtered unlike the other channels: at 50 mHz by the factor 0.958, and 0.55 s late",
    ),
    "slow drift": (
        {"o_12": lambda c: c["o_12"] + 1e-6 * np.linspace(0, 1, N) ** 2},
        {"slow drift"},
        "o_12 or a force contains a slow drift of",
    ),
    "mean of three": (
        {"o_12": lambda c: np.convolve(np.pad(c["o_12"], 1, mode="edge"), np.ones(3) / 3, "valid")},
        {"filter"},
        "o_12 was filtered unlike the other channels: at 50 mHz by the factor 0.967",
    ),
    "read-outs exchanged": (
        {"o_1": lambda c: c["o_12"], "o_12": lambda c: c["o_1"]},
        {"exchange"},
        "o_1 and o_12 are exchanged",
    ),
    "in reverse": (
        {name: (lambda c, name=name: c[name][::-1]) for name in ("o_1", "o_12", "f_x_1", "f_x_2")},
        {"reverse"},
        "samples are in reverse order",
    ),
    "lost sample": (
        {"f_x_2": lambda c: switched(9000, c["f_x_2"], late(c["f_x_2"], -1))},
        {"lag of a part"},
        "f_x_2 is early by 1 sample from",
    ),
    "gain from an instant on": (
        {"f_x_2": lambda c: switched(12000, c["f_x_2"], 1.01 * c["f_x_2"])},
        {"scale of a part"},
        "1.0",
    ),
    "jump": (
        {"o_12": lambda c: switched(8000, c["o_12"], c["o_12"] + 3e-11)},
        {"jump"},
        "o_12 jumps by 3e-11 m at 8000 s",
    ),
    "gain that drifts": (
        {"f_x_2": lambda c: c["f_x_2"] * np.linspace(0.995, 1.005, N)},
        {"scale drift"},
        "the scale of f_x_2 grows by 0.99",
    ),
    "sine": (
        {"f_x_2": lambda c: c["f_x_2"] + 1e-13 * np.sin(2 * np.pi * 7.3e-3 * np.arange(N))},
        {"line"},
        "a sine of 7.3 mHz and 1.1e-13 m s-2",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_cause_is_named_and_no_other_kind(name):
    channels, kinds, words = FAULTS[name]
    named = causes(**channels)
    assert {kind for kind, _ in named} <= kinds
    assert any(words in clause for _, clause in named), named


@pytest.mark.slow
def test_fault_without_a_correction_has_no_cause():
    rng = np.random.default_rng(5)
    assert causes(o_12=lambda c: c["o_12"] + rng.standard_normal(N).cumsum() * 1e-11) == []
    shuffled = np.arange(N).reshape(-1, 240)
    shuffled[40] = rng.permutation(shuffled[40])
    kinds = {kind for kind, _ in causes(f_x_2=lambda c: c["f_x_2"][shuffled.ravel()])}
    assert kinds <= {"segments"}
