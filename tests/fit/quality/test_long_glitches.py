"""Glitches of seconds to hours, as in flight: found and taken out, or too weak to move anything."""

from dataclasses import replace

import numpy as np
import pytest

from fit.fitting.experiment_and_joint_fit import fit_experiment, fit_joint
from fit.quality import glitches
from fit.settings import settings
from fit.whitening import Experiment
from fit.whitening.run import Run
from tests.fit.quality.test_glitches import search
from tests.oracles import thirteen
from tests.oracles.glitches import Glitch, draw, struck

NONE = ((), ())


def experiment(name, found=NONE, seed=0):
    """Return an experiment struck by glitches in its sysid run and in its noise run."""
    kinds = zip(("sysid", "noise"), found, strict=True)
    return Experiment(*(Run(struck(thirteen.made(name, kind, seed), which)) for kind, which in kinds))


def shifts(outcome, clean):
    """Return by how many sigma of a clean fit its parameters moved."""
    told = ~clean.undetermined
    return ((outcome.solution.theta - clean.solution.theta) / clean.solution.sigma)[told]


def test_long_glitches_are_taken_out_and_cost_nothing():
    sysid = [Glitch(4000.0, 30.0, 1500.0, "one", 60.0, 2)]
    noise = [Glitch(9000.0, 50.0, 300.0, "none", 100.0, 2)]
    struck_by = experiment("B4", (sysid, noise))
    after, warnings = search(struck_by)
    assert [w.code for w in warnings] == ["glitches"] * 2
    assert after.sysid.weight > 0.97 * struck_by.sysid.weight
    spans = [(s.begin, s.end) for s in warnings[0].spans]
    for glitch in sysid:
        assert any(begin - 60 <= glitch.begin <= end for begin, end in spans)
    clean, before, found = (fit_experiment(e) for e in (experiment("B4"), struck_by, after))
    assert np.max(np.abs(shifts(before, clean))) > 3  # something was at stake
    assert np.max(np.abs(shifts(found, clean))) < 0.5
    assert found.solution.chi2 / found.solution.dof == pytest.approx(1, abs=0.1)
    whole, left = (sum(b.size for b in outcome.whitened_runs) for outcome in (before, found))
    assert whole - left == 4 * len(after.sysid.glitches) > 0


@pytest.mark.parametrize("rise", [1.8, 4.8])
def test_a_strong_short_one_that_raises_the_psd_is_masked(rise):
    struck_by = experiment("D4", ((), [Glitch(14321.3, rise, 6.0, "none", 1000.0, 2)]), seed=3)
    after, (said,) = search(struck_by)
    assert "taken out" not in said.message
    assert after.noise.glitches == ()
    assert sum(span.end - span.begin for span in said.spans) < 120
    before, found = (fit_experiment(e) for e in (experiment("D4", seed=3), after))
    assert np.max(np.abs(shifts(found, before))) < 0.2


# In 94 of 100 draws; in the others noise beside the glitch passes for more of it.
@pytest.mark.parametrize(
    ("name", "glitch", "seed"),
    [
        ("D2", Glitch(15417.0, 331.3, 1058.3, "both", -20.7, 1), 17),
        ("B2", Glitch(17306.0, 519.3, 2251.3, "none", -102.2, 1), 17),
    ],
)
def test_one_glitch_is_taken_out_by_one_shape_its_own(name, glitch, seed):
    after, _ = search(experiment(name, ([glitch], ()), seed))
    (found,) = after.sysid.glitches
    sign = -1 if glitch.hand == "both" else 1
    assert found.shape.kind == ("bipolar" if glitch.hand == "none" else "double_exponential")
    assert found.shape.tau == pytest.approx(glitch.fall, rel=0.2)
    assert found.shape.ratio == pytest.approx(sign * glitch.rise / glitch.fall, abs=0.1)
    assert found.begin == pytest.approx(glitch.begin, abs=0.02 * glitch.fall)


def test_a_mask_of_seconds_hardly_moves_what_one_run_tells():
    # a notch in the window lets the ramp of test mass 1 leak: C_1 moved by 0.3 sigma
    clean, mask = experiment("G3", seed=6), [(12603.0, 12608.0)]
    masked = Experiment(clean.sysid.mask_by_impulses(mask), clean.noise)
    assert masked.sysid.n_masked == 5
    assert masked.sysid.weight == clean.sysid.weight
    before, after = (fit_experiment(e) for e in (clean, masked))
    assert np.max(np.abs(shifts(after, before))) < 0.2
    notched = Experiment(clean.sysid.mask(mask), clean.noise)
    assert np.max(np.abs(shifts(fit_experiment(notched), before))) > 0.25


@pytest.mark.parametrize(("channel", "strong"), [("o_12", 0.2), ("f_x_2", 10.0)])
def test_whatever_is_in_a_patch_tells_nothing(channel, strong):
    clean = experiment("B4")
    telemetry = clean.sysid.telemetry
    spoilt = telemetry.channels[channel].copy()
    spoilt[9000:9004] += np.array([1.0, -3.0, 2.0, 5.0]) * strong * np.std(np.diff(spoilt))
    channels = {**telemetry.channels, channel: spoilt}
    before, after = (
        fit_experiment(
            Experiment(Run(replace(telemetry, channels=of)).mask_by_impulses([(8998.0, 9005.0)]), clean.noise)
        )
        for of in (telemetry.channels, channels)
    )
    assert np.max(np.abs(shifts(after, before))) < 0.02
    struck_by = Experiment(Run(replace(telemetry, channels=channels)), clean.noise)
    assert np.max(np.abs(shifts(fit_experiment(struck_by), before))) > 1


def test_patches_that_overlap_or_reach_over_the_end_take_no_more_than_there_is():
    run = experiment("B4").sysid
    end = float(run.telemetry.time[-1])
    once, beside, last = (
        run.mask_by_impulses(stretches).spectra((0.2, 0.2)).nuisance
        for stretches in ([(9000.0, 9010.0)], [(9000.0, 9008.0), (9002.0, 9010.0)], [(end - 5, end)])
    )
    assert once.shape == beside.shape
    assert 2 <= last.shape[1] < once.shape[1]
    # as many as the band holds in that time, some more at its ends
    long = run.mask_by_impulses([(9000.0, 9200.0)]).spectra((0.2, 0.2)).nuisance
    assert 40 < long.shape[1] < 70
    assert np.linalg.cond(np.vstack([long.real, long.imag])[:, 2:]) < 1.01


def test_a_long_mask_is_a_notch_lest_it_hide_the_onset_of_a_long_glitch():
    glitch = Glitch(17461.0, 1191.4, 6933.2, "one", -191.4, 2)
    after, _ = search(experiment("D2", ((), [glitch]), seed=2))
    assert all(end - begin <= glitches.MAX_SEGMENT for begin, end in after.noise.patches)
    assert after.noise.glitches


def test_nothing_is_taken_out_of_noise_louder_than_the_noise_run_tells():
    # five times the noise at low frequencies: a matter of chi2, not of glitches
    rng, sysid = np.random.default_rng(1), experiment("B4").sysid.telemetry
    f = np.fft.rfftfreq(sysid.time.size)
    S = (60e-15 * 5 * 20e-6 / np.maximum(f, f[1])) ** 2
    draws = rng.standard_normal((2, f.size))
    push = np.sqrt(S * sysid.time.size / 4) * (draws[0] + 1j * draws[1]) * (f > 0) * (f < 0.1)
    o_12 = np.fft.irfft(push / (-4e-7 - (2 * np.pi * f) ** 2), sysid.time.size)
    channels = {**sysid.channels, "o_12": sysid.channels["o_12"] + o_12}
    loud = Run(replace(sysid, channels=channels))
    after, _ = search(Experiment(loud, experiment("B4").noise))
    assert len(after.sysid.glitches) <= 1


@pytest.mark.slow
@pytest.mark.stat
def test_glitches_of_seconds_to_hours_leave_the_joint_estimates():
    # not taken out they move an estimate by 2.8 sigma; the seed is fixed: it passes or fails for good
    rng, clean, after, n_glitches = np.random.default_rng(7000), [], [], 0
    for name in thirteen.PLANS:
        drawn = [draw(rng, 1, thirteen.made(name, kind).duration) for kind in ("sysid", "noise")]
        n_glitches += sum(map(len, drawn))
        clean.append(experiment(name))
        after.append(search(experiment(name, drawn))[0])
    assert n_glitches >= 15
    no_scatter = settings({"scatter": []})
    moved = np.abs(shifts(fit_joint(after, no_scatter), fit_joint(clean, no_scatter)))
    assert np.max(moved) < 1
    assert np.sqrt(np.mean(moved**2)) < 0.4
