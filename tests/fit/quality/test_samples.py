"""Samples that no instrument gives are named and placed; noise, rounding and gaps are no faults."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fit.quality import metadata, samples
from fit.whitening import pair
from tests.oracles import closed_loop, thirteen

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


def messages(sysid, noise_run):
    return [cause.words for cause in samples.check_samples(sysid, noise_run)]


def faults(**changes):
    return messages(run(**changes), run("noise"))


def constant(start, stop):
    return lambda x: np.where((np.arange(x.size) >= start) & (np.arange(x.size) < stop), x[start], x)


def filled(start, stop):
    def function(x):
        x[start:stop] = np.linspace(x[start], x[stop], stop - start)
        return x

    return function


def stale(x):
    x[99::50] = x[98::50]
    return x


def every(period, start=5):
    """Return a function that interpolates the samples of a comb from their neighbours."""

    def function(x):
        x[start:-1:period] = (x[start - 1 : -2 : period] + x[start + 1 :: period]) / 2
        return x

    return function


def plus(amount, start, stop=N):
    return lambda x: x + amount * ((np.arange(x.size) >= start) & (np.arange(x.size) < stop))


@pytest.mark.parametrize(
    ("name", "fault", "words"),
    [
        ("o_12", constant(0, N), "o_12 is .* throughout"),
        ("o_12", constant(5000, 5600), "o_12 is .* for 600 s at 5000 s"),
        ("o_1", filled(5000, 5060), "o_1 is a straight line for 60 s at 5000 s"),
        ("f_x_1", lambda x: 0 * x, "f_x_1 is stuck at 0 throughout"),
        ("f_x_2", lambda x: np.where(np.arange(x.size) // 2 == 3000, 0, x), "f_x_2 is exactly 0 at 6001 s"),
        ("o_12", lambda x: np.concatenate([x[:8000], x[7999:-1]]), "o_12 repeats a sample at 8000 s"),
        ("f_x_2", stale, "f_x_2 repeats a sample 39\\d times, first at 99 s"),
        ("o_12", lambda x: np.tile(x[:3600], 6)[:N], "o_12 repeats every 3600 s at 0 s"),
        (
            "o_12",
            lambda x: np.tile(x[:3600], 6)[:N][::-1] * np.where(np.arange(N) == 9, 0, 1),
            "is rounded: it has 360",
        ),
        ("o_12", every(15, 8), "o_12 is interpolated: 7 % of its samples lie on the line"),
        ("o_1", lambda x: np.minimum(x, np.quantile(x, 0.98)), "o_1 stops at its limit of"),
        ("o_1", plus(1e-7, 12345), r"o_1 jumps by 1e-07 m at 1234[45] s"),
        ("o_12", plus(-3e-10, 7000), r"o_12 jumps by -3e-10 m at (6999|7000) s"),
        (
            "o_12",
            lambda x: np.where(np.arange(N) < 7250, x, -x),
            r"o_12 changes its sign and jumps by -2.2e-09 m",
        ),
        ("o_12", plus(1e-6, 7000, 7001), "o_12 is off by 1e-06 m at 7000 s"),
    ],
)
def test_faulty_samples_are_named(name, fault, words):
    message = faults(**{name: fault})[0]
    assert re.search(words, message), message


@pytest.mark.parametrize(
    "channels",
    [
        {},
        {"o_12": lambda x: x.astype(np.float32).astype(float)},
        {"o_12": lambda x: 1e-16 * np.round(x / 1e-16), "f_x_2": lambda x: 1e-17 * np.round(x / 1e-17)},
        {"o_12": lambda x: np.where(np.arange(x.size) % 5000 < 50, np.nan, x)},
        {"o_12": lambda x: 0.01 * x + 5e-11 * np.maximum(np.arange(N) - 5000.0, 0)},
        dict.fromkeys(("o_1", "o_12", "f_x_1", "f_x_2"), lambda x: np.concatenate([x[:8000], x[7999:-1]])),
        {"o_1": lambda x: np.concatenate([np.zeros(5), x[5:]])},
    ],
    ids=["clean", "single", "rounded", "gaps", "slope", "all repeated", "from zero"],
)
def test_sound_samples_raise_no_fault(channels):
    assert not faults(**channels)


def test_a_command_at_the_limit_of_its_authority_is_not_stuck():
    limited = {"f_x_2": lambda x: np.clip(x, None, np.quantile(x, 0.9))}
    clipped = run(**limited)
    assert "f_x_2 stops at its limit of" in messages(clipped, run("noise"))[0]
    authority = float(clipped.channels["f_x_2"].max()) * clipped.m_tm
    assert not messages(replace(clipped, F_max_2=authority), run("noise"))


def test_few_equal_neighbours_of_values_with_few_digits_are_chance():
    steps = np.random.default_rng(5).normal(size=N)
    x = np.array([float(f"{value:.6e}") for value in 1e-10 * (1 + 1e-3 * np.cumsum(steps))])
    assert 1 <= np.count_nonzero(np.diff(x) == 0) < 30
    assert not faults(f_x_2=lambda _: x)
    repeated = np.concatenate([x[:8000], x[7900:7999].repeat(2), x[8198:]])
    assert "repeats a sample" in faults(f_x_2=lambda _: repeated)[0]


def test_a_command_that_nothing_feeds_back_may_stay_the_same():
    still = run("noise", f_x_1=lambda x: 0 * x, f_x_2=lambda x: 0 * x)
    driven = run(f_x_2=lambda x: np.where(np.arange(x.size) % 4000 < 2000, x, 0), f_x_1=lambda x: 0 * x)
    assert not messages(driven, still)
    assert not messages(driven, None)


def test_sines_that_begin_and_end_are_no_jumps():
    sysid, noise_run = (thirteen.telemetry(thirteen.made("B4", kind)) for kind in ("sysid", "noise"))
    assert not messages(sysid, noise_run)
    silence = closed_loop.Noise(plateau=0.0, tail=0.0, oms=0.0, thruster=0.0, jitter=0.0)
    still = thirteen.telemetry(replace(thirteen.made("B4", "sysid"), noise=silence))
    assert not [words for words in messages(still, None) if "jumps" in words]


def experiments(spoilt):
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
    (note,) = [n for n in metadata.screen(experiments("ACD")).notes if n.code == "interpolated"]
    assert note.kind.unsound
    report = metadata.screen(experiments("D"))
    (fault,) = report.exclusions
    assert fault.experiment == "D"
    assert "D-sysid.h5: f_x_2 is interpolated: 8 % of its samples" in fault.reason
    assert not [n for n in report.notes if n.code == "interpolated"]
