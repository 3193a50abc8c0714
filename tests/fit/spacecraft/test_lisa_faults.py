"""Telemetry of LISA whose channels are not what they are called, and constraints that it contradicts."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import fit
from fit.spacecraft.lisa import DYNAMICS, GEOMETRY
from tests.oracles import lisa_loop

WORLD = lisa_loop.World()


@lru_cache(maxsize=1)
def campaign():
    return lisa_loop.campaign(WORLD, lisa_loop.sequence(1e-6))


def with_channels(**changes):
    """Return the campaign with channels replaced by functions of the channels of the same run."""
    return [
        replace(run, channels={**run.channels, **{name: f(run.channels) for name, f in changes.items()}})
        for run in campaign()
    ]


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"F_y_1": lambda c: -c["F_y_1"]}, "invalid_data", "F_y_1: lambda_y_1 is estimated as -"),
        (
            {"F_y_1": lambda c: c["F_y_2"], "F_y_2": lambda c: c["F_y_1"]},
            "invalid_data",
            "F_y_1: x_per_y_1 is estimated as ",
        ),
        ({"grs_y_2": lambda c: 4 * c["grs_y_2"]}, "invalid_data", "grs_y_2: grs_gain_y_2 is estimated as "),
        ({"F_y_2": lambda c: np.roll(c["F_y_2"], 5)}, "implausible_delay", "F_y_2 acts "),
        (
            {"o_1": lambda c: 1.02 * c["o_1"]},
            "constraint_contradicted",
            "the data contradict the constraints",
        ),
    ],
)
def test_estimates_from_faulty_channels_are_not_sound(changes, code, words):
    joint = fit.calibrate(with_channels(**changes)).joint
    assert any(w.code == code and w.message.startswith(words) for w in joint.unsound)


def exchanged(*names):
    """Return changes by which pairs of channels are exchanged."""
    pairs = [(name, name.replace("_1", "_2")) for name in names]
    both = [*pairs, *((b, a) for a, b in pairs)]
    return {a: lambda c, b=b: c[b] for a, b in both}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (exchanged("o_1", "grs_y_1", "F_y_1"), "test masses 1 and 2 are exchanged"),
        (exchanged("o_1"), "o_1 and o_2 are exchanged"),
        (exchanged("grs_y_1"), "grs_y_1 and grs_y_2 are exchanged"),
        ({"o_1": lambda c: -c["o_1"]}, "o_1 has the wrong sign"),
        ({"grs_y_2": lambda c: -c["grs_y_2"]}, "grs_y_2 has the wrong sign"),
    ],
)
def test_exchanged_channels_and_wrong_signs_are_named(changes, words):
    with pytest.raises(fit.InputError, match=rf"A-sysid\.h5: {words}: the residual is"):
        fit.calibrate(with_channels(**changes))


def with_geometry(**attributes):
    """Return the campaign with other attributes."""
    return [replace(run, attributes={**run.attributes, **attributes}) for run in campaign()]


MILLIRADIAN = {
    "misaligned interferometer": lambda: with_channels(o_1=lambda c: c["o_1"] + 1e-3 * c["grs_y_1"]),
    "half opening": lambda: with_geometry(half_opening=np.pi / 6 + 3e-4),
    "turned read-out": lambda: with_channels(
        o_1=lambda c: c["o_1"] + 1e-3 * c["grs_y_1"], grs_y_1=lambda c: c["grs_y_1"] - 1e-3 * c["o_1"]
    ),
}


@pytest.mark.parametrize("name", MILLIRADIAN)
def test_a_milliradian_is_within_the_uncertainties(name):
    joint = fit.calibrate(MILLIRADIAN[name]()).joint
    assert not joint.unsound
    pulls = {n: abs(e.value - WORLD.truth[n]) / e.sigma for n, e in joint.parameters.items()}
    assert max(pulls[n] for n in DYNAMICS) < 3.5
    assert max(pulls[n] for n in GEOMETRY) < 1.5


@pytest.mark.parametrize("name", MILLIRADIAN)
def test_a_milliradian_of_axes_that_are_stated_as_exact_is_not_sound(name):
    exact = {name: {"value": 0.0, "vary": False} for name in GEOMETRY}
    joint = fit.calibrate(MILLIRADIAN[name](), parameters=exact).joint
    assert "constraint_contradicted" in {w.code for w in joint.unsound}


def test_axes_may_be_as_far_off_as_a_prior_says():
    runs = with_channels(o_1=lambda c: c["o_1"] + 0.02 * c["grs_y_1"])
    wide = {"o_per_y_1": {"prior": (0.0, 0.02)}}
    joint = fit.calibrate(runs, parameters=wide).joint
    assert not joint.unsound
    assert joint["o_per_y_1"].value == pytest.approx(0.02, abs=4.5 * joint["o_per_y_1"].sigma)


def test_axes_far_from_what_is_assumed_are_not_sound():
    joint = fit.calibrate(with_channels(o_1=lambda c: c["o_1"] + 0.02 * c["grs_y_1"])).joint
    assert "constraint_contradicted" in {w.code for w in joint.unsound}


@pytest.mark.parametrize("channel", ["o_2", "grs_y_1", "F_y_2"])
def test_channel_in_another_unit_is_named(channel):
    runs = with_channels(**{channel: lambda c: 1e3 * c[channel]})
    with pytest.raises(fit.InputError, match=rf"\.h5: {channel}: its noise is .* in another unit$"):
        fit.calibrate(runs)


@pytest.mark.parametrize(
    ("setting", "is_contradicted"),
    [
        ({"value": WORLD.truth["lambda_y_1"], "vary": False}, False),
        ({"value": 1.0, "vary": False}, True),
        ({"expr": "lambda_y_2"}, True),
        ({"prior": [1.06, 1e-5]}, True),
        ({"max": 1.04}, True),
    ],
)
def test_constraints_are_tested_against_the_data(setting, is_contradicted):
    joint = fit.calibrate(campaign(), parameters={"lambda_y_1": setting}).joint
    assert ("constraint_contradicted" in {w.code for w in joint.unsound}) == is_contradicted
    assert any(w.code == "constrained" and "lambda_y_1" in w.message for w in joint.warnings)
