"""Events: drawn by name, in blocks of any size, as often and as large as asked for."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scipy

from lpfcosim.models import one_axis, stimuli
from lpfcosim.signals import events
from lpfcosim.spacecraft import Authority, Events, Run

EVENTS = Events(glitches_per_day=60.0, gaps_per_day=20.0, gap_duration=20.0)
DAY = 86400
RUN = Run(
    name="one",
    experiment="one",
    kind="noise",
    n_samples=216_000,
    truth=one_axis.MODEL.stated_truth,
    control=one_axis.MODEL.stated_control,
    authority=Authority("A", 0.0, 2.2e-9, 1e-11, 1e-11),
    noise={"plateau": 5e-15, "tail": 1.0},
    events=EVENTS,
    seed=3,
)


def test_a_glitch_gives_its_impulse_or_takes_it_back():
    time = np.arange(0, 8_000, 0.1)
    for two_sided in (False, True):
        glitch = events.Glitch(2, 100.0, 20.0, 300.0, -7e-12, two_sided)
        velocity = scipy.integrate.cumulative_trapezoid(glitch.acceleration(time), time)
        assert not glitch.acceleration(time)[time < 100].any()
        assert np.min(velocity) == pytest.approx(-7e-12, rel=0.01, abs=0)
        assert velocity[-1] == pytest.approx(0.0 if two_sided else -7e-12, abs=0.01 * 7e-12)
        assert np.max(velocity) <= 0


def test_drawing_knows_neither_order_nor_blocks():
    whole = stimuli.noise(RUN)
    stream = stimuli.noise_source(RUN)
    parts = [stream.take(n) for n in (1, 9_999, 106_000, 100_000)]
    for name in ("g_1", "g_2"):
        np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), whole[name])
    other = replace(RUN, name="two")
    assert events.glitches(other) != events.glitches(RUN)
    assert events.gaps(other) != events.gaps(RUN)
    # another rate of gaps or noise leaves the glitches where they are
    assert events.glitches(replace(RUN, events=replace(EVENTS, gaps_per_day=0.0))) == events.glitches(RUN)


def test_glitches_act_on_their_test_mass_and_on_nothing_else():
    result = events.glitches(RUN)
    struck, rest = (
        stimuli.noise(RUN),
        stimuli.noise(replace(RUN, events=replace(EVENTS, glitches_per_day=0.0))),
    )
    for j in (1, 2):
        expected = sum(glitch.acceleration(RUN.time) for glitch in result if glitch.mass == j)
        np.testing.assert_allclose(struck[f"g_{j}"] - rest[f"g_{j}"], expected, atol=1e-22)
    for name in set(struck) - {"g_1", "g_2"}:
        np.testing.assert_array_equal(struck[name], rest[name])


@pytest.mark.stat
def test_rate_and_sizes_are_as_asked_for():
    # 2000 days at one a day: 5 sigma, a false alarm in 2e6
    drawn = [
        glitch
        for seed in range(200)
        for glitch in events.glitches(
            replace(RUN, seed=seed, n_samples=DAY * 100, events=Events(glitches_per_day=1.0))
        )
    ]
    n = len(drawn)
    assert abs(n - 2000) < 5 * np.sqrt(2000)
    sizes = np.log10([abs(glitch.impulse) for glitch in drawn])
    assert abs(sizes.mean() + 11) < 5 * 0.5 / np.sqrt(n)
    assert abs(sizes.std() - 0.5) < 5 * 0.5 / np.sqrt(2 * n)
    assert abs(np.mean([glitch.two_sided for glitch in drawn]) - 0.3) < 5 * np.sqrt(0.21 / n)
    assert abs(np.mean([glitch.mass == 1 for glitch in drawn]) - 0.5) < 2.5 / np.sqrt(n)
    assert {5 <= glitch.fall <= 7200 and glitch.rise < glitch.fall for glitch in drawn} == {True}


def test_gaps_are_no_more_than_telemetry_may_lack():
    greedy = Events(gaps_per_day=1000.0, gap_duration=400.0)
    for seed in range(50):
        run = replace(RUN, events=greedy, seed=seed, n_samples=10 * 43_200)
        result = events.gaps(run)
        assert result
        assert all(end - begin <= 600 for begin, end in result)
        assert all(later[0] > sooner[1] for sooner, later in pairwise(result))
        for rate in (1.0, 10.0):
            lost = events.missing(run, np.arange(int(43_200 * rate)) / rate)
            assert 0 < lost.mean() <= 0.01
