"""What changes in mid-run is found, and named where one channel explains it."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fit.pipeline import calibrate
from fit.quality import constancy, glitches
from fit.whitening import Experiment
from fit.whitening.run import Run
from tests.oracles import thirteen
from tests.oracles.synthetic import World
from tests.oracles.synthetic import pair as open_loop


@cache
def telemetry(kind, hidden=None):
    return thirteen.telemetry(thirteen.made("B4", kind), hidden=hidden)


def found(hidden=None, **channels):
    """Return what is said of an experiment whose channels are changed."""
    sysid = telemetry("sysid", hidden)
    changed = {name: function(sysid.channels[name].copy()) for name, function in channels.items()}
    sysid = replace(sysid, channels={**sysid.channels, **changed})
    return constancy.change(Experiment(Run(sysid), Run(telemetry("noise"))))


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


def turned(start):
    return lambda x: np.where(np.arange(x.size) < start, x, -x)


def pulsed(size, start):
    return lambda x: x + size * ((np.arange(x.size) >= start) & (np.arange(x.size) < start + 3))


def plus(size, start):
    return lambda x: x + size * (np.arange(x.size) >= start)


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        (
            {"f_x_2": late(1.0, 5000)},
            r"f_x_2 changes at (49|50)\d\d s: it acts 1 s, 1 of its samples, earlier",
        ),
        ({"f_x_2": turned(10000)}, r"f_x_2 changes at 10000 s: from then on it acts -1 times as much"),
        ({"f_x_2": second_half(1.3)}, r"f_x_2 changes at 10900 s: .* 0\.78\d* times as much"),
        ({"o_12": second_half(-1.0)}, r"no equation of motion holds from 10[89]\d\d s to"),
        ({"f_x_2": pulsed(1e-10, 12000)}, r"\d s"),
        ({"f_x_2": plus(1e-11, 9000)}, r"\d s"),
    ],
    ids=["late", "sign", "gain", "sign of o_12", "pulse", "jump"],
)
def test_a_change_is_named(channels, words):
    assert re.search(words, found(**channels) or "")


def test_one_equation_from_begin_to_end_is_left_alone():
    # chi2 of the most that changes reached 0.45 of the limit in 40 campaigns
    assert found() is None
    assert found(f_x_2=lambda x: 1.01 * x) is None
    assert found(o_12=lambda x: -x, o_1=lambda x: -x, f_x_1=lambda x: -x, f_x_2=lambda x: -x) is None


@pytest.mark.parametrize(("name", "hours"), [("A2", 65.0), ("B2", 65.0), ("D3", 260.0)])
def test_a_long_quiet_part_is_left_alone(name, hours):
    # there commands answer noise alone, which moves their coefficients: chi2 110 to 140 without any change
    made = thirteen.made(name, "sysid", seed=4)
    sysid = thirteen.telemetry(replace(made, duration=3600 * hours))
    noise = Run(thirteen.telemetry(thirteen.made(name, "noise", seed=4)))
    assert constancy.change(Experiment(Run(sysid), noise)) is None
    changed = {**sysid.channels, "f_x_2": second_half(0.9)(sysid.channels["f_x_2"])}
    assert constancy.change(Experiment(Run(replace(sysid, channels=changed)), noise))


def growing(size):
    draw = np.convolve(np.random.default_rng(3).standard_normal(50000), np.ones(9) / 3, "same")

    def hidden(time, channels):
        return 0 * time, 0 * time, np.where(time > 11000, size * draw[: time.size], 0.0)

    return hidden


def test_noise_that_grows_is_no_change_of_the_dynamics():
    assert found(growing(1e-15)) is None
    assert re.search(r"^noise or forces change at 1[01]\d\d\d s", found(growing(8e-15)))


def test_without_a_noise_run_the_residual_has_to_do():
    sysid = telemetry("sysid")
    assert constancy.change(Experiment(Run(sysid), None)) is None
    halved = {**sysid.channels, "f_x_2": second_half(1.3)(sysid.channels["f_x_2"])}
    assert "f_x_2" in (constancy.change(Experiment(Run(replace(sysid, channels=halved)), None)) or "")


def test_glitches_that_are_masked_are_no_change():
    def hidden(time, channels):
        return 0 * time, 0 * time, 1e-11 * ((time > 7000) & (time < 7010))

    e = Experiment(Run(telemetry("sysid", hidden)), Run(telemetry("noise")))
    assert constancy.change(glitches.remove_glitches(e).experiment) is None


def test_an_experiment_that_changes_stays_out_by_name():
    runs = [*open_loop(World(), "A", seed=1), *open_loop(World(), "E", seed=2, drive_1=1e-12)]
    runs += open_loop(World(), "B", seed=3)
    clean = calibrate(runs[:4]).joint
    weaker = second_half(0.9)(runs[4].channels["f_x_2"])
    runs[4] = replace(runs[4], channels={**runs[4].channels, "f_x_2": weaker})
    results = calibrate(runs)
    assert results.provenance.joint_runs == ["A-sysid", "E-sysid"]
    assert results.joint.values == clean.values
    assert not results.joint.unsound
    (told,) = (w.message for w in results.joint.warnings if w.code == "rejected")
    assert told.startswith("left out of the joint fit: B-sysid.h5: ")
