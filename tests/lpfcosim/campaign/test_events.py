"""The table [events]: what it makes of the runs, and the sentence for all that can be wrong with it."""

import h5py
import numpy as np
import pytest

from fit.telemetry.reader import read_all, read_truth
from lpfcosim.campaign import loading
from lpfcosim.signals import events
from tests import ROOT
from tests.campaign_text import SHORT_PLAN
from tests.reference_run import simulate_equations

QUICKSTART = ROOT / "campaigns" / "quickstart.toml"
HISTORY = """plateau = [
  { date = "2016-04-16T08:00:00Z", level = "5.57 fm s^-2 Hz^-0.5" },
  { date = "2016-04-17T08:00:00Z", level = "1.74 fm s^-2 Hz^-0.5" },
]
"""


@pytest.fixture
def events_of(extended):
    """Write a campaign with a table of events."""
    return lambda text: extended(f"[events]\n{text}", "events")


def test_plateau_falls_with_the_date(events_of):
    runs = loading.load(events_of(HISTORY)).runs
    # A has no plateau of its own, B to D have
    falling = [5.57e-15, 5.57e-15 * (1.74 / 5.57) ** 0.25]
    assert [run.noise["plateau"] for run in runs[:2]] == pytest.approx(falling, rel=1e-6, abs=0)
    assert [run.noise["plateau"] for run in runs[2::2]] == [5e-15, 4e-15, 3e-15]
    path = events_of(HISTORY)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("[events]", 't0 = "2017-04-16T08:00:00Z"\n[events]'), encoding="utf-8")
    assert loading.load(path).runs[0].noise["plateau"] == pytest.approx(1.74e-15, rel=1e-6, abs=0)


def test_tail_scatters_from_experiment_to_experiment(events_of):
    plain, scattered = loading.load(QUICKSTART).runs, loading.load(events_of("tail_scatter = 0.2")).runs
    factors = [a.noise["tail"] / b.noise["tail"] for a, b in zip(scattered, plain, strict=True)]
    assert factors[::2] == factors[1::2]  # a noise run is of its experiment
    assert len(set(factors)) == 4
    assert 0.05 < np.std(np.log(factors[::2])) < 0.6


def test_telemetry_has_gaps_and_the_truth_of_its_glitches(tmp_path):
    path = tmp_path / "short.toml"
    text = SHORT_PLAN.replace('duration = "200 s"', 'duration = "5000 s"\nsample_rate = "1 Hz"')
    table = '[events]\nglitches_per_day = 200.0\ngaps_per_day = 70.0\ngap_duration = "6 s"\n'
    path.write_text(text.replace("[noise]", f"{table}\n[noise]"), encoding="utf-8")
    plan = loading.load(path)
    _, run = plan.runs
    _, telemetry = read_all(simulate_equations(plan, tmp_path / "out"))
    lost = events.missing(run, telemetry.time)
    assert 0 < lost.mean() < 0.01
    for values in telemetry.channels.values():
        np.testing.assert_array_equal(np.isnan(values), lost)
    assert read_truth(telemetry.path)["plateau"] == pytest.approx(5.6e-15, rel=1e-6, abs=0)
    with h5py.File(telemetry.path) as opened:
        drawn = events.glitches(run)
        np.testing.assert_array_equal(opened["truth/glitch_begin"], [glitch.begin for glitch in drawn])
        np.testing.assert_array_equal(opened["truth/glitch_impulse"], [glitch.impulse for glitch in drawn])
        assert opened["truth/glitch_impulse"].attrs["units"] == "m s-1"
