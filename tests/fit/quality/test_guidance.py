"""Guidance that does not belong to its read-outs is told with what would make it so; clean runs are not."""

from dataclasses import replace

import numpy as np
import pytest

from fit.pipeline import calibrate
from fit.quality import loop_response, metadata
from fit.whitening.runs import pair
from tests.oracles import thirteen

NAMES = ("A1", "C2", "D2", "G3")  # the last one injects other frequencies, and forces beside


@pytest.fixture(scope="module")
def runs():
    return thirteen.campaign(3, names=NAMES)


def said(runs):
    return [w.message for w in loop_response.odd(loop_response.seen(pair(list(runs.values()))))]


def changed(runs, name, **channels):
    """Return the runs, in one of them channels replaced by a function of all of them."""
    run = runs[f"{name}-sysid"]
    new = {channel: f(run.channels) for channel, f in channels.items()}
    return runs | {run.run: replace(run, channels={**run.channels, **new})}


def of(channel, f=lambda values: values):
    return lambda channels: f(channels[channel])


FAULTS = {
    "exchanged": (
        {"guidance_o_1": of("guidance_o_12"), "guidance_o_12": of("guidance_o_1")},
        "o_1 answers guidance_o_12, not guidance_o_1 of its own and o_12 answers guidance_o_1",
    ),
    "scaled": (
        {"guidance_o_1": of("guidance_o_1", lambda g: 2 * g)},
        "o_1 answers guidance_o_1 by 0.5 times",
    ),
    "sign": ({"guidance_o_12": of("guidance_o_12", np.negative)}, "o_12 answers guidance_o_12 by -1 times"),
    "late": (
        {"guidance_o_1": of("guidance_o_1", lambda g: np.roll(g, 20))},
        "o_1 answers guidance_o_1 about 21 s too early",
    ),
    "lost": (
        {"guidance_o_12": of("guidance_o_12", np.zeros_like)},
        "that its guidance does not show",
    ),
    "not answered": (
        {"o_12": of("o_12", lambda o: 1e-12 * np.random.default_rng(1).standard_normal(o.size))},
        "o_12 does not answer guidance_o_12",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_guidance_of_other_data_is_told_by_name(runs, fault):
    channels, expected = FAULTS[fault]
    (message,) = said(changed(runs, "C2", **channels))
    assert "C2-sysid.h5" in message
    assert expected in message


def test_clean_runs_are_not(runs):
    assert said(runs) == []
    assert said({name: run for name, run in runs.items() if name[0] in "AC"}) == []  # two tell nothing


def test_a_controller_of_its_own_is_not(runs):
    # an answer that is smaller above a mHz, and later there
    def slower(o):
        spectrum, f = np.fft.rfft(o), np.fft.rfftfreq(o.size)
        return np.fft.irfft(spectrum / (1 + 1j * f / 2e-3), o.size)

    assert said(changed(runs, "D2", o_1=of("o_1", slower))) == []


def test_what_most_runs_do_is_no_fault(runs):
    for name in ("A1", "C2", "D2"):
        runs = changed(runs, name, guidance_o_1=of("guidance_o_1", lambda g: 2 * g))
    assert len(said(runs)) <= 1


def test_it_is_a_note_of_the_joint_fit(runs):
    spoilt = changed(runs, "C2", **FAULTS["exchanged"][0])
    assert [w.code for w in metadata.faults(pair(list(spoilt.values()))).notes] == ["guidance_response"]


@pytest.mark.slow  # two fits
def test_the_estimates_stay(runs):
    spoilt = changed(runs, "C2", **FAULTS["exchanged"][0])
    clean, found = (calibrate(list(of_all.values())).joint for of_all in (runs, spoilt))
    assert not found.unsound
    assert [e.value for e in found.parameters.values()] == [e.value for e in clean.parameters.values()]
    assert "guidance_response" in [w.code for w in found.warnings]
