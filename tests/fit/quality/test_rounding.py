"""Rounding by number formats: its steps are found, explain repeats and lines, and count as they add noise."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy

from fit.errors import InputError
from fit.pipeline import calibrate
from fit.quality import rounding, samples
from fit.quality.resolution import estimate_resolution
from tests.oracles import thirteen

CHANNELS = ("o_1", "o_12", "f_x_1", "f_x_2")
CONSTANT_FORCE = 8e-12  # m s^-2, of the command on test mass 2


def single(x):
    return x.astype(np.float32).astype(float)


def digits(count):
    return lambda x: np.array([float(f"{value:.{count - 1}e}") for value in x])


def counts(bits):
    """Scaled integers of so many bits, as of a converter or of FITS."""

    def function(x):
        step = np.abs(x).max() / (2 ** (bits - 1) - 1)
        return step * np.round(x / step) if step else x

    return function


def offset_by(offset):
    return lambda x: single(x + offset)


@cache
def flown(name="A2", fs=1.0):
    """An experiment whose command on test mass 2 holds a constant force, and its noise run."""
    runs = [thirteen.telemetry(thirteen.made(name, kind), fs=fs) for kind in ("sysid", "noise")]
    return [
        replace(run, channels={**run.channels, "f_x_2": run.channels["f_x_2"] - CONSTANT_FORCE})
        for run in runs
    ]


def stored(function, channels=CHANNELS, **flight):
    return [
        replace(run, channels={**run.channels, **{c: function(run.channels[c].copy()) for c in channels}})
        for run in flown(**flight)
    ]


def faults(runs):
    return [cause.words for cause in samples.check_samples(*runs)]


@cache
def plain():
    return calibrate(flown()).joint


@pytest.mark.parametrize(
    ("function", "step"),
    [
        (lambda x: x, None),
        (single, 2.0**-50),  # of 12 nm
        (digits(7), 1e-14),
        (lambda x: digits(7)(x * 1.928) / 1.928, 1e-14 / 1.928),
        (lambda x: 3e-13 * np.round(x / 3e-13), 3e-13),
        (lambda x: 3e-9 * np.round(x / 3e-9), 3e-9),
        (counts(24), 12e-9 / (2**23 - 1)),
        (offset_by(1e-5), 2.0**-40),
        (lambda x: np.where(np.arange(x.size) % 500 < 40, np.nan, single(x)), 2.0**-50),
    ],
    ids=["double", "single", "7 digits", "N", "steps", "coarse", "24 bits", "offset", "gaps"],
)
def test_steps_of_stored_numbers(function, step):
    n = np.arange(40_000)
    noise = 1e-11 * np.random.default_rng(3).standard_normal(n.size)
    x = 12e-9 * np.sin(0.001 * n) + noise
    x[0] = 12e-9 + (1e-12 if step and step > 1e-10 else 0)
    resolution = estimate_resolution(function(x))
    if step is None:
        assert resolution is None
    else:
        assert resolution.largest == pytest.approx(step, rel=0.01)


@pytest.mark.parametrize("function", [digits(7), lambda x: x.astype(np.float32)], ids=["7 digits", "float32"])
def test_a_number_format_moves_no_estimate(function):
    runs = stored(function)
    assert not faults(runs)
    joint = calibrate(runs).joint
    assert set(joint) == set(plain())
    assert not [
        w for w in joint.warnings if w.code in ("coarse_quantisation", "suspect_samples", "quantisation")
    ]
    for name, estimate in plain().parameters.items():
        assert abs(joint[name].value - estimate.value) < 0.02 * estimate.sigma
        assert joint[name].sigma == pytest.approx(estimate.sigma, rel=1e-3)


@pytest.mark.parametrize(
    ("function", "steps", "limit"),
    [
        (lambda x: 7e-15 * np.round(x / 7e-15), "steps of 7e-15 m: this adds 0.00", 0.2),
        (digits(6), "steps of 1e-13 m where it is largest: this adds 0.0", 0.5),
    ],
    ids=["fixed", "6 digits"],
)
def test_the_shift_that_rounding_may_cause_is_reported(function, steps, limit):
    joint = calibrate(stored(function, ("o_12",))).joint
    warning = next(w for w in joint.warnings if w.code == "quantisation")
    assert not joint.unsound
    assert re.search(f"o_12 is rounded to {steps}.* times the power of the noise", warning.message)
    bound = float(re.search("may move by ([^ ]*) sigma", warning.message)[1])
    shifts = [abs(joint[name].value - e.value) / e.sigma for name, e in plain().parameters.items()]
    assert 0.01 < max(shifts) < bound < limit


@pytest.mark.parametrize(
    ("function", "channel", "words"),
    [
        (
            offset_by(1e-3),
            "o_1",
            "1.2e-10 m .single precision about an offset of 0.001 m.: .* power of the noise of o_1",
        ),
        (digits(4), "o_12", "1e-11 m where it is largest: this adds"),
        (
            lambda x: 1e-14 * np.round(x / 1e-14),
            "f_x_2",
            "1e-14 m s-2 about an offset of -1.7e-11 m s-2: this adds",
        ),
    ],
    ids=["offset of o_1", "4 digits", "command"],
)
def test_steps_that_add_noise_are_faults(function, channel, words):
    with pytest.raises(InputError, match=f"A2-sysid.h5: {channel} is rounded to steps of {words}") as caught:
        calibrate(stored(function, (channel,)))
    assert rounding.CURE in str(caught.value)


def constant(x, begin, size):
    x[begin : begin + size] = x[begin]


def line(x, begin, size):
    x[begin : begin + size + 1] = np.linspace(x[begin], x[begin + size], size + 1)


def in_memory(fs, seed=3, size=30_000):
    """A read-out of white noise on a slow tone, that moves by about a hundred steps of single precision."""
    n = np.arange(size)
    noise = 1e-13 * np.random.default_rng(seed).standard_normal(size)
    walk = scipy.signal.lfilter(
        [1], [1, -0.9995], 2e-12 * np.random.default_rng(seed + 1).standard_normal(size)
    )
    return 9e-9 * np.sin(2 * np.pi * 1e-3 * n / fs) + noise + walk


@pytest.mark.parametrize("fs", [1.0, 10.0])
@pytest.mark.parametrize("fault", [constant, line])
@pytest.mark.parametrize(
    "function", [lambda x: x, single, digits(7), counts(24)], ids=["double", "single", "7 digits", "24 bits"]
)
def test_short_stretches_are_located(function, fault, fs):
    """Of 31 to 95 samples, several of them in a run, whether or not few samples of a run are compared."""
    x = in_memory(fs)
    stretches = {4001 + 1237 * k: size for k, size in enumerate((31, 32, 38, 45, 60, 95))}
    for begin, size in stretches.items():
        fault(x, begin, size)
    x = function(x)
    faulty = [
        (round(fault.begin * fs), round(fault.end * fs))
        for fault in samples.channel_faults(x, fs, estimate_resolution(x))
    ]
    assert len(faulty) == len(stretches)
    for (begin, end), (expected, size) in zip(faulty, stretches.items(), strict=True):
        assert abs(begin - expected) <= 8  # at a power of ten, where steps change within a line
        assert abs(end - expected - size) <= 3


@pytest.mark.parametrize("function", [single, digits(7), counts(20)], ids=["single", "7 digits", "20 bits"])
@pytest.mark.parametrize("channel", ["o_1", "o_12", "f_x_2"])
def test_quiet_parts_of_a_clean_run_are_no_faults(function, channel):
    """Before the first injection and after the last, rounding makes longer lines than in between."""
    for run in flown():
        x = function(run.channels[channel].copy())
        assert not (samples.channel_faults(x, run.fs, estimate_resolution(x)))


@pytest.mark.parametrize("shift", [0.25, 1e3 / 7])
def test_an_offset_leaves_the_step_of_a_lattice(shift, step=3e-13):
    for run in stored(lambda x: step * np.round(x / step) + shift * step, ("o_12",)):
        resolution = estimate_resolution(run.channels["o_12"])
        assert resolution.fixed
        assert resolution.largest == pytest.approx(step, rel=1e-6)
        faulty = samples.channel_faults(run.channels["o_12"], run.fs, resolution)
        assert "repetition" not in {fault.kind for fault in faulty}


@pytest.mark.parametrize("function", [single, digits(6), counts(20)], ids=["single", "6 digits", "20 bits"])
def test_the_mean_that_was_taken_off_leaves_the_step(function):
    n = np.arange(60_000)
    walk = scipy.signal.lfilter([1], [1, -0.9995], 2e-11 * np.random.default_rng(3).standard_normal(n.size))
    x = function(walk + 1e-8 * np.sin(2 * np.pi * 1e-3 * n) + 1.1e-6)
    resolution = estimate_resolution(x - x.mean())
    assert resolution.fixed
    assert resolution.largest == pytest.approx(estimate_resolution(x).largest, rel=1e-6)
    assert not samples.channel_faults(x - x.mean(), 10.0, resolution)


def test_a_whole_run_that_is_interpolated():
    x = in_memory(1.0)
    n = np.arange(x.size)
    x = single(np.interp(n, n[::100], x[::100]))
    lines = [f for f in samples.channel_faults(x, 1.0, estimate_resolution(x)) if f.kind == "line"]
    assert sum(line.end - line.begin for line in lines) > 0.9 * x.size


def test_a_ramp_of_double_precision_is_no_lattice():
    """Its samples are nearly evenly spaced, as those of a large slow command."""
    increments = 3.5e-13 * (1 + 3e-3 * np.random.default_rng(5).standard_normal(20_000))
    assert estimate_resolution(1.5e-9 + np.cumsum(increments)) is None
