"""A change of coefficients within a run is a structural break, with its channel where one accounts for it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fit.pipeline import calibrate
from fit.quality import glitches
from fit.quality.structural_break import structural_break
from fit.settings import settings
from fit.whitening import Experiment
from fit.whitening.run import Run
from tests.hostile.spoiling import SEED
from tests.oracles import thirteen
from tests.oracles.synthetic import World
from tests.oracles.synthetic import pair as open_loop


@cache
def telemetry(kind, hidden=None):
    return thirteen.telemetry(thirteen.made("B4", kind), hidden=hidden)


def find_break(hidden=None, **channels):
    """Return what changes in an experiment whose channels are altered."""
    sysid = telemetry("sysid", hidden)
    changed = {name: function(sysid.channels[name].copy()) for name, function in channels.items()}
    sysid = replace(sysid, channels={**sysid.channels, **changed})
    return structural_break(Experiment(Run(sysid), Run(telemetry("noise"))))


def late(seconds, start):
    """Late from a sample on, by a part of it."""

    def function(x):
        n = np.arange(x.size)
        f = np.fft.rfftfreq(2 * x.size)
        whole = np.fft.irfft(np.fft.rfft(np.r_[x, x[::-1]]) * np.exp(-2j * np.pi * f * seconds), 2 * x.size)
        return np.where(n < start, x, whole[: x.size])

    return function


def second_half(factor):
    """Scale about the mean, so that nothing jumps."""
    return lambda x: np.where(np.arange(x.size) < 10900, x, x.mean() + factor * (x - x.mean()))


def reversed_sign(start):
    return lambda x: np.where(np.arange(x.size) < start, x, -x)


def pulse(size, start):
    return lambda x: x + size * ((np.arange(x.size) >= start) & (np.arange(x.size) < start + 3))


def step(size, start):
    return lambda x: x + size * (np.arange(x.size) >= start)


@pytest.mark.parametrize(
    ("channels", "kind", "onset"),
    [
        ({"f_x_2": late(1.0, 5000)}, "break", 5000),
        ({"f_x_2": reversed_sign(10000)}, "break", 10000),
        ({"f_x_2": second_half(1.3)}, "break", 10900),
        ({"o_12": late(0.3, 10000)}, "break", 10000),
        ({"o_12": second_half(-1.0)}, "segment", 10900),
    ],
    ids=["lag", "sign", "scale", "lag of o_12", "sign of o_12"],
)
def test_a_break_has_its_channel_and_its_onset(channels, kind, onset):
    cause = find_break(**channels)
    assert cause.kind == kind
    assert cause.channel == ("" if kind == "segment" else "f_x_2 o_12")  # test mass 1 is not driven
    assert cause.onset == pytest.approx(onset, abs=120)


@pytest.mark.parametrize(
    "channels", [{"f_x_2": pulse(1e-10, 12000)}, {"f_x_2": step(1e-11, 9000)}], ids=["pulse", "step"]
)
def test_unrecorded_forces_are_a_break(channels):
    assert find_break(**channels)


def test_constant_coefficients_are_no_break():
    assert not find_break()
    assert not find_break(f_x_2=lambda x: 1.01 * x)
    assert not find_break(o_12=lambda x: -x, o_1=lambda x: -x, f_x_1=lambda x: -x, f_x_2=lambda x: -x)


@pytest.mark.parametrize(("name", "hours"), [("A2", 65.0), ("D3", 130.0)])
def test_a_long_undriven_part_is_no_break(name, hours):
    # there commands answer the noise alone, which biases their coefficients: chi^2 100 without any change
    made = thirteen.made(name, "sysid", seed=4)
    sysid = thirteen.telemetry(replace(made, duration=3600 * hours))
    noise = Run(thirteen.telemetry(thirteen.made(name, "noise", seed=4)))
    assert not structural_break(Experiment(Run(sysid), noise))
    changed = {**sysid.channels, "f_x_2": second_half(0.9)(sysid.channels["f_x_2"])}
    assert structural_break(Experiment(Run(replace(sysid, channels=changed)), noise))


def growing_noise(size):
    draw = np.convolve(np.random.default_rng(3).standard_normal(50000), np.ones(9) / 3, "same")

    def hidden(time, channels):
        return 0 * time, 0 * time, np.where(time > 11000, size * draw[: time.size], 0.0)

    return hidden


def test_noise_that_grows_is_no_change_of_the_dynamics():
    assert not find_break(growing_noise(1e-15))
    cause = find_break(growing_noise(8e-15))
    assert (cause.kind, cause.channel) == ("noise", "")
    assert cause.size > 10


def test_slow_noise_that_is_louder_than_that_of_the_noise_run_is_no_break():
    made = thirteen.made("B2", "sysid", seed=SEED)
    louder = replace(made, noise=replace(made.noise, tail=5 * made.noise.tail))
    noise = Run(thirteen.telemetry(thirteen.made("B2", "noise", seed=SEED)))
    sysid = thirteen.telemetry(louder)
    assert not structural_break(Experiment(Run(sysid), noise))
    changed = {**sysid.channels, "f_x_2": second_half(1.1)(sysid.channels["f_x_2"])}
    assert structural_break(Experiment(Run(replace(sysid, channels=changed)), noise))


def test_without_a_noise_run_the_residual_gives_the_noise():
    sysid = telemetry("sysid")
    assert not structural_break(Experiment(Run(sysid), None))
    halved = {**sysid.channels, "f_x_2": second_half(1.3)(sysid.channels["f_x_2"])}
    assert structural_break(Experiment(Run(replace(sysid, channels=halved)), None))


def test_glitches_that_are_masked_are_no_break():
    def hidden(time, channels):
        return 0 * time, 0 * time, 1e-11 * ((time > 7000) & (time < 7010))

    e = Experiment(Run(telemetry("sysid", hidden)), Run(telemetry("noise")))
    assert not structural_break(glitches.remove_glitches(e).experiment)


@pytest.mark.parametrize("values", [{}, {"glitches": False, "estimator": "flscov"}], ids=str)
def test_an_experiment_with_a_break_is_excluded(values):
    runs = [*open_loop(World(), "A", seed=1), *open_loop(World(), "E", seed=2, drive_1=1e-12)]
    runs += open_loop(World(), "B", seed=3)
    clean = calibrate(runs[:4], settings(values)).joint
    weaker = second_half(0.9)(runs[4].channels["f_x_2"])
    runs[4] = replace(runs[4], channels={**runs[4].channels, "f_x_2": weaker})
    results = calibrate(runs, settings(values))
    assert results.provenance.joint_runs == ["A-sysid", "E-sysid"]
    assert results.joint.values == clean.values
    assert not results.joint.unsound
    (message,) = (w.message for w in results.joint.warnings if w.code == "rejected")
    assert message.startswith("left out of the joint fit: B-sysid.h5: ")
