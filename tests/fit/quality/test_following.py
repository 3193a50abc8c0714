"""An o_1 that is recorded too large is told by the guidance it follows; loops of their own are not."""

from dataclasses import replace

import numpy as np
import pytest

from fit.quality import following, loop_response, metadata
from fit.whitening.runs import pair
from tests.oracles import thirteen

NAMES = ("A1", "C2", "D2", "G3")


@pytest.fixture(scope="module")
def runs():
    return thirteen.campaign(3, names=NAMES)


def changed(runs, names, channel, f):
    """Return the runs, in some of them a channel replaced by a function of it."""
    found = dict(runs)
    for name in names:
        run = found[f"{name}-sysid"]
        found[run.run] = replace(run, channels=run.channels | {channel: f(run.channels[channel])})
    return found


def said(runs):
    experiments = pair(list(runs.values()))
    return following.faults(experiments, loop_response.seen(experiments))


def slower(o):
    """What a loop would make of it that follows a few millihertz only."""
    spectrum, f = np.fft.rfft(o), np.fft.rfftfreq(o.size)
    return np.fft.irfft(spectrum / (1 + 1j * f / 4e-3 - (f / 3e-3) ** 2), o.size)


def test_clean_runs_follow(runs):
    assert said(runs) == {}


@pytest.mark.parametrize("scale", [1.05, 0.95])
def test_a_scale_is_told_in_the_run_that_has_it(runs, scale):
    found = said(changed(runs, ["A1"], "o_1", lambda o: scale * o))
    assert list(found) == ["A1"]
    (reason,) = found["A1"]
    assert reason.startswith("A1-sysid.h5: o_1 follows guidance_o_1 by ")
    value, _, sigma = reason.split(" by ")[1].split(" times")[0].split()
    assert abs(float(value) - scale) < 4 * float(sigma) < 0.02


def test_guidance_that_is_too_small_is_told_all_the_same(runs):
    assert list(said(changed(runs, ["G3"], "guidance_o_1", lambda g: g / 1.05))) == ["G3"]


@pytest.mark.parametrize(
    ("channel", "f"),
    [
        ("o_1", lambda o: 1.01 * o),
        ("o_1", lambda o: 2 * o),  # that tells itself
        ("o_1", slower),
        ("o_1", lambda o: np.roll(o, 3)),
        ("o_1", lambda o: o + 1e-6),
        ("guidance_o_1", np.zeros_like),
        ("guidance_o_1", np.negative),
        ("guidance_o_12", lambda g: 1.05 * g),
    ],
    ids=["little", "much", "slow", "late", "offset", "no guidance", "sign", "o_12"],
)
def test_other_departures_are_not_taken_for_a_scale(runs, channel, f):
    assert said(changed(runs, ["C2"], channel, f)) == {}


def test_runs_that_do_not_tell_follow_the_others_of_their_epoch(runs):
    silent = changed(runs, ["G3"], "guidance_o_1", np.zeros_like)
    silent["G3-sysid"] = replace(silent["G3-sysid"], alignment_epoch=2)
    both = said(changed(silent, ["C2", "D2"], "o_1", lambda o: 1.06 * o))
    assert sorted(both) == ["C2", "D2", "G3"]
    assert "nothing tells its o_1 from that of C2, D2" in both["G3"][0]
    assert list(said(changed(silent, ["C2"], "o_1", lambda o: 1.06 * o))) == ["C2"]


def test_it_leaves_out_few_and_spoils_many(runs):
    few = metadata.faults(pair(list(changed(runs, ["C2"], "o_1", lambda o: 1.06 * o).values())))
    assert [f.experiment for f in few.left_out] == ["C2"]
    assert "guidance_scale" not in {n.code for n in few.notes}
    many = metadata.faults(pair(list(changed(runs, ["A1", "C2", "D2"], "o_1", lambda o: 1.06 * o).values())))
    assert many.left_out == []
    (note,) = [n for n in many.notes if n.code == "guidance_scale"]
    assert note.kind.unsound


def test_the_scale_is_as_sure_as_it_says():
    # a known answer in noise that grows with frequency, of 6 h
    rng, off = np.random.default_rng(5), []
    f = np.arange(1, 200) / 21600.0
    for _ in range(300):
        asked = np.exp(-(((f - 0.8e-3) / 1e-4) ** 2)) + np.exp(-(((f - 1.7e-3) / 1e-4) ** 2)) + 1e-6
        noise = 1e-3 * (f / 1e-3) * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
        answered = asked * (1.02 + 0.03j * f / 1e-3 - 0.01 * (f / 1e-3) ** 2) + noise
        seen = loop_response.Seen("", f, {"o_1": asked + 0j}, {"o_1": answered})
        scale, _, sigma = following._scale(seen)
        off.append((scale - 1.02) / sigma[0])
    assert abs(np.mean(off)) < 0.2
    assert 0.85 < np.std(off) < 1.25
