"""Telemetry of LISA whose channels are not what they are called, and constraints that it contradicts."""

from dataclasses import replace

import numpy as np
import pytest

import fit
from fit.spacecraft.lisa import DYNAMICS, GEOMETRY
from tests.oracles.lisa_loop import WORLD, pulls

EXACT = {name: {"value": 0.0, "vary": False} for name in GEOMETRY}


def with_channels(campaign, **changes):
    """Return the campaign with channels replaced by functions of the channels of the same run."""
    return [
        replace(run, channels={**run.channels, **{name: f(run.channels) for name, f in changes.items()}})
        for run in campaign
    ]


def exchanged(*names):
    """Return changes by which pairs of channels are exchanged."""
    pairs = [(name, name.replace("_1", "_2")) for name in names]
    both = [*pairs, *((b, a) for a, b in pairs)]
    return {a: lambda c, b=b: c[b] for a, b in both}


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"F_y_1": lambda c: -c["F_y_1"]}, "invalid_data", "F_y_1: lambda_y_1 is estimated as -"),
        (exchanged("F_y_1"), "invalid_data", "F_y_1: x_per_y_1 is estimated as "),
        ({"grs_y_2": lambda c: 4 * c["grs_y_2"]}, "invalid_data", "grs_y_2: grs_gain_y_2 is estimated as "),
        ({"F_y_2": lambda c: np.roll(c["F_y_2"], 5)}, "implausible_delay", "F_y_2 acts "),
    ],
)
def test_estimates_from_faulty_channels_are_not_sound(campaign, changes, code, words):
    joint = fit.calibrate(with_channels(campaign, **changes)).joint
    assert any(w.code == code and w.message.startswith(words) for w in joint.unsound)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (exchanged("o_1", "grs_y_1", "F_y_1"), "test masses 1 and 2 are exchanged"),
        (exchanged("o_1"), "o_1 and o_2 are exchanged"),
        ({"grs_y_2": lambda c: -c["grs_y_2"]}, "grs_y_2 has the wrong sign"),
    ],
)
def test_exchanged_channels_and_wrong_signs_are_named(campaign, changes, words):
    with pytest.raises(fit.InputError, match=rf"A-sysid\.h5: {words}: the residual is"):
        fit.calibrate(with_channels(campaign, **changes))


def with_half_opening(campaign):
    """Return the campaign with telescopes that point 0.3 mrad elsewhere."""
    half_opening = {"half_opening": np.pi / 6 + 3e-4}
    return [replace(run, attributes={**run.attributes, **half_opening}) for run in campaign]


def turned_by(angle):
    """Return changes by which the read-outs of test mass 1 are turned by an angle [rad]."""
    return {
        "o_1": lambda c: c["o_1"] + angle * c["grs_y_1"],
        "grs_y_1": lambda c: c["grs_y_1"] - angle * c["o_1"],
    }


@pytest.mark.parametrize(
    "turn", [with_half_opening, lambda c: with_channels(c, **turned_by(1e-3))], ids=["opening", "read-out"]
)
def test_a_milliradian_is_within_the_uncertainties_unless_axes_are_stated_as_exact(campaign, turn):
    joint = fit.calibrate(turn(campaign)).joint
    assert not joint.unsound
    of_dynamics = {name: e for name, e in joint.parameters.items() if name in DYNAMICS}
    assert pulls(replace(joint, parameters=of_dynamics)).max() < 3.5
    exact = fit.calibrate(turn(campaign), parameters=EXACT).joint
    assert "constraint_contradicted" in {w.code for w in exact.unsound}


def test_axes_far_from_what_is_assumed_are_not_sound(campaign):
    joint = fit.calibrate(with_channels(campaign, o_1=turned_by(0.02)["o_1"])).joint
    assert "constraint_contradicted" in {w.code for w in joint.unsound}


def test_axes_may_be_as_far_off_as_a_prior_says(campaign):
    wide = {"o_per_y_1": {"prior": (0.0, 0.02)}}
    joint = fit.calibrate(with_channels(campaign, o_1=turned_by(0.02)["o_1"]), parameters=wide).joint
    assert not joint.unsound
    assert joint["o_per_y_1"].value == pytest.approx(0.02, abs=4.5 * joint["o_per_y_1"].sigma)


@pytest.mark.parametrize("channel", ["grs_y_1", "F_y_2"])
def test_channel_in_another_unit_is_named(campaign, channel):
    runs = with_channels(campaign, **{channel: lambda c: 1e3 * c[channel]})
    with pytest.raises(fit.InputError, match=rf"\.h5: {channel}: its noise is .* in another unit$"):
        fit.calibrate(runs)


@pytest.mark.parametrize(
    ("setting", "is_contradicted"),
    [({"value": WORLD.truth["lambda_y_1"], "vary": False}, False), ({"expr": "lambda_y_2"}, True)],
)
def test_constraints_are_tested_against_the_data(campaign, setting, is_contradicted):
    joint = fit.calibrate(campaign, parameters={"lambda_y_1": setting}).joint
    assert ("constraint_contradicted" in {w.code for w in joint.unsound}) == is_contradicted
    assert any(w.code == "constrained" and "lambda_y_1" in w.message for w in joint.warnings)
