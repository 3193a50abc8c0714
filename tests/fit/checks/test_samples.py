"""Samples that no instrument gives are placed; noise, motion, rounding and gaps are no faults."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fit.checks import apply, checked
from fit.whitening import Experiment, pair
from fit.whitening.run import Run
from tests.fit.checks.campaigns import campaign as campaign_of
from tests.oracles import thirteen

N = 20000


def noise(seed=1, size=N):
    """A read-out in m: noise, red below and white above, with a sine."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.standard_normal(size)) * 1e-12
    return walk + 3e-12 * rng.standard_normal(size) + 1e-9 * np.sin(2 * np.pi * 1e-3 * np.arange(size))


def run(kind="sysid", **changes):
    """Return a run in closed loop, whose channels are all noise, some of them changed."""
    channels = {name: 1e-3 * noise(n) for n, name in enumerate(("f_x_1", "f_x_2"))}
    channels |= {"o_1": noise(3), "o_12": noise(4)}
    changed = {name: function(channels[name].copy()) for name, function in changes.items()}
    short = thirteen.telemetry(_SHORT, fs=1.0)
    return replace(short, kind=kind, time=np.arange(N) * 1.0, channels=channels | changed)


_SHORT = replace(thirteen.made("B4", "noise"), duration=600.0)


CHANNELS = ("o_1", "o_12", "f_x_1", "f_x_2")
CODES = ("invalid_data", "interpolated")


def messages(sysid):
    """Return what is found in a run, whose noise run has noise in all channels."""
    e = Experiment(Run(sysid), Run(run("noise")))
    found = apply("samples", campaign_of([e]))
    return [
        f.message.removeprefix(f"{sysid.path}: ") for f in found if f.channel in CHANNELS and f.code in CODES
    ]


def faults(**changes):
    return messages(run(**changes))


def constant(start, stop):
    return lambda x: np.where((np.arange(x.size) >= start) & (np.arange(x.size) < stop), x[start], x)


def filled(start, stop):
    def function(x):
        x[start:stop] = np.linspace(x[start], x[stop], stop - start)
        return x

    return function


def every(period, start=5):
    """Return a function that interpolates the samples of a comb from their neighbours."""

    def function(x):
        x[start:-1:period] = (x[start - 1 : -2 : period] + x[start + 1 :: period]) / 2
        return x

    return function


def plus(amount, start, stop=N):
    return lambda x: x + amount * ((np.arange(x.size) >= start) & (np.arange(x.size) < stop))


def single(x):
    return x.astype(np.float32).astype(float)


def steps(size):
    return lambda x: size * np.round(x / size)


@pytest.mark.parametrize(
    ("name", "fault", "words"),
    [
        ("o_12", constant(0, N), "o_12 is constant throughout"),
        ("o_12", constant(5000, 5600), "o_12 is .* for 60[01] s at 5000 s"),
        ("o_1", filled(5000, 5060), "o_1 is .* line for 60 s at 5000 s"),
        ("f_x_1", lambda x: 0 * x, "f_x_1 is constant throughout, at 0"),
        (
            "f_x_2",
            lambda x: np.clip(x, None, np.quantile(x, 0.9)),
            "f_x_2 is constant or a straight line for .* s at",
        ),
        ("o_12", lambda x: single(constant(5000, 5600)(x)), "o_12 is .* for 60[01] s at 5000 s"),
        ("o_12", every(15, 8), "o_12 is interpolated: 7 % of its samples lie on the line"),
        ("o_12", lambda x: x[: N // 2].repeat(2), "o_12 is interpolated: 50 %"),
        ("o_1", plus(1e-7, 12345), "o_1 jumps by 1e-07 m at 12345 s"),
        ("o_12", plus(-3e-10, 7000), "o_12 jumps by -3e-10 m at 7000 s"),
    ],
)
def test_faulty_samples_are_placed(name, fault, words):
    message = faults(**{name: fault})[0]
    assert re.search(words, message), message


@pytest.mark.parametrize(
    "channels",
    [
        {},
        dict.fromkeys(CHANNELS, single),
        {"o_12": lambda x: 1e-16 * np.round(x / 1e-16), "f_x_2": lambda x: 1e-15 * np.round(x / 1e-15)},
        {"o_12": lambda x: np.where(np.arange(x.size) % 5000 < 50, np.nan, x)},
        {"o_12": lambda x: 0.01 * x + 5e-11 * np.maximum(np.arange(N) - 5000.0, 0)},
        {"o_12": lambda x: x + 5e-11 * np.arange(N)},
        {"o_1": lambda x: np.concatenate([np.zeros(5), x[5:]])},
    ],
    ids=["clean", "single", "rounded", "gaps", "turn", "slope", "from zero"],
)
def test_sound_samples_raise_no_fault(channels):
    assert not faults(**channels)


def test_spikes_are_masked_and_jumps_are_faults():
    hit = run(o_12=lambda x: plus(1e-6, 7000, 7002)(plus(-1e-10, 3000, 3001)(x)))
    masked = checked(campaign_of([Experiment(Run(hit), None)]), "samples")
    (e,) = masked.experiments.values()
    assert [round((begin + end) / 2) for begin, end in e.sysid.masks] == [3000, 7000]
    assert ["2 spikes masked, at " in finding.message for finding in masked.findings] == [True]
    moved = campaign_of([Experiment(Run(run(o_12=plus(1e-6, 7000))), None)])
    assert [finding.code for finding in apply("samples", moved)] == ["invalid_data"]


def experiments(**channels):
    runs = [thirteen.telemetry(thirteen.made("B4", kind)) for kind in ("sysid", "noise")]
    for n, one in enumerate(runs):
        changed = {name: function(one.channels[name]) for name, function in channels.items()}
        runs[n] = replace(one, channels={**one.channels, **changed})
    return pair(runs)


def found(**channels):
    campaign = campaign_of(experiments(**channels))
    return [*apply("samples", campaign), *apply("files", campaign)]


def test_a_command_that_nothing_feeds_back_or_that_is_at_its_limit_may_stay_the_same():
    assert not found(f_x_1=lambda x: 0 * x)
    (e,) = experiments(f_x_2=lambda x: np.clip(x, -1e-12, 1e-12))
    assert "f_x_2 is constant" in apply("samples", campaign_of([e]))[0].message
    force = float(e.sysid.telemetry.channels["f_x_2"].max()) * e.sysid.telemetry.m_tm
    limited = [Run(replace(one.telemetry, F_max_2=force)) for one in (e.sysid, e.noise)]
    assert not apply("files", campaign_of([replace(e, sysid=limited[0], noise=limited[1])]))


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        (dict.fromkeys(CHANNELS, single), ""),
        ({"f_x_2": steps(1e-16)}, ""),
        ({"o_12": lambda x: x + np.linspace(0, 1e-6, x.size)}, ""),
        ({"f_x_2": steps(1e-14)}, "f_x_2 to steps of 1e-14"),
        ({"o_1": steps(1e-9)}, "o_1 to steps of 1e-09"),
    ],
    ids=["single", "fine", "slope", "command", "o_1"],
)
def test_rounding_is_a_fault_where_it_would_move_estimates(channels, words):
    messages = [finding.message for finding in found(**channels)]
    assert len(messages) == bool(words)
    assert all(words in message for message in messages)


def interpolated(spoilt):
    """Return four of them, every twelfth sample of f_x_2 interpolated in the sysid runs of some."""
    return pair([independent_run(name, kind, spoilt) for name in "ABCD" for kind in ("sysid", "noise")])


def independent_run(name, kind, spoilt):
    seed = 10 * ord(name) + (kind == "noise")
    channels = {c: noise(100 * seed + n) for n, c in enumerate(("o_1", "o_12", "f_x_1", "f_x_2"))}
    if name in spoilt and kind == "sysid":
        channels["f_x_2"] = every(12)(channels["f_x_2"])
    channels = {c: x * (1e-3 if c[0] == "f" else 1) for c, x in channels.items()}
    label = f"{name}-{kind}"
    return replace(run(kind), run=label, experiment=name, path=f"{label}.h5", channels=channels)


def test_samples_that_are_interpolated_in_most_runs_spoil_the_fit():
    def decided(spoilt):
        campaign = campaign_of(interpolated(spoilt))
        return campaign.decide(f for f in apply("samples", campaign) if f.code == "interpolated")

    (common,) = decided("ACD").of_joint
    assert common.kind.unsound and not decided("ACD").faulty
    (fault,) = decided("D").findings
    assert decided("D").faulty == {"D"}
    assert "D-sysid.h5: f_x_2 is interpolated: 8 % of its samples" in fault.message
