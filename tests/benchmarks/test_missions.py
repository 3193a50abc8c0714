"""The benchmarks of the mission: what they draw, and what they make of it."""

import json

import numpy as np
import pytest

from lpfcosim.campaign import loading
from tests.benchmarks import flight, missions


@pytest.fixture(scope="module")
def plan():
    return loading.load(missions.CAMPAIGN)


def test_missions_have_truths_of_their_own(plan):
    one, other = (missions.drawn(plan, number, "whole") for number in (1, 2))
    again = missions.drawn(plan, 1, "whole")
    assert [r.seed for r in one.runs] == [r.seed for r in again.runs] != [r.seed for r in other.runs]
    assert one.runs[0].spacecraft == again.runs[0].spacecraft != other.runs[0].spacecraft
    assert one.truth.lambda_2 != other.truth.lambda_2
    assert {r.experiment for r in one.runs} == {r.name for r in plan.runs if r.kind == "sysid"}


def test_cross_talk_is_that_after_the_lever_arm_times_a_factor(plan):
    plain = {r.name: r.spacecraft for r in plan.runs}
    ratios = set()
    for run in missions.drawn(plan, 3, "whole").runs:
        b, before = run.spacecraft.b, plain[run.name].b
        left, was = b[0] + run.spacecraft.delta_y, before[0] + plain[run.name].delta_y
        assert 0.65 < left / was < 1.35  # drift is beside the factor
        ratios.add(round(b[2] / before[2], 9))
    assert len(ratios) == 1


def test_along_x_there_is_no_spacecraft(plan):
    assert not any(r.spacecraft for r in missions.drawn(plan, 0, "x").runs)
    runs = missions.drawn(plan, 0, "euler").runs
    assert {r.inertial_period: r.n_samples for r in runs} == dict.fromkeys((1, 2, 3), 3 * 864_000)


@pytest.mark.slow
def test_a_mission_along_x_is_fitted():
    line = missions.trial(0, "x")
    assert not line.get("failed") and not line["unsound"]
    assert set(line["pulls"]) == set(missions.joint_names([1, 2, 3, 4]))
    assert max(map(abs, line["pulls"].values())) < 4.5
    assert "lambda_2" in line["scatter"]


def test_the_table_counts_what_is_sound():
    kept = {"unsound": [], "left_out": [], "scatter": {"lambda_2": 0.003}}
    epochs = {"1: b_3": 1.0, "2: b_3": -1.0, "delta_ifo_1": 0.0, "delta_ifo_2": 0.0}
    lines = [{"number": n, "pulls": {"C_1": p, **epochs}, **kept} for n, p in enumerate((-1.5, 0.5, 1.0))]
    lines += [
        {"number": 3, "failed": "no"},
        {"number": 4, "pulls": {"C_1": 9.0}, **kept, "unsound": ["marginalised_noise"]},
    ]
    head, *_, row, b_3, delta_ifo = missions.table(lines)
    assert b_3.startswith("| b_3 | 6 |") and delta_ifo.startswith("| delta_ifo | 6 |")
    assert head.startswith(
        "5 missions, 1 without a joint fit, 1 whose uncertainties are not valid; 3 are counted"
    )
    assert row == "| C_1 | 3 | +0.00 ± 0.76 | 1.32 ± 0.41 | 33 % | 1.5 |"


def test_table_and_summary_are_written(tmp_path, monkeypatch):
    page, log = tmp_path / "page.md", tmp_path / "log"
    page.write_text("a\n<!-- from missions.py x -->\nold\n<!-- end of missions.py x -->\nb\n")
    kept = {"unsound": [], "left_out": [], "scatter": {}}
    done = [{"number": n, "pulls": {"C_1": 0.1 * n}, **kept} for n in range(2)]
    log.write_text("".join(json.dumps(line) + "\n" for line in ({"kind": "x"}, *done)))
    monkeypatch.setattr(missions, "DOCS", page)
    monkeypatch.setattr("sys.argv", ["missions", "--log", str(log), "--docs"])
    missions.main()
    text = page.read_text()
    assert text.startswith("a\n") and text.endswith("\nb\n")
    assert "Mean pulls are +0.05 to +0.05" in text
    assert "old" not in text
    assert "C_1,2,+0.05" in (tmp_path / "mission-pulls-x.csv").read_text()


def test_levels_are_those_of_stretches_without_glitches():
    rng, fs = np.random.default_rng(0), 1.0
    x = 3e-15 * np.sqrt(fs / 2) * rng.standard_normal(200_000)
    x[50_000:50_100] += 1e-12
    quiet, stretches = flight.level(x, fs, 1e-2, 3600.0, [(50_000.0, 50_100.0)])
    assert quiet == pytest.approx(3e-15, rel=0.03)
    assert stretches < flight.level(x, fs, 1e-2, 3600.0, [])[1]
    assert flight.level(x, fs, 1e-3, 7200.0, [])[0] > 2 * quiet
    assert np.isnan(flight.level(x, fs, 1e-4, 40_000.0, [(0.0, 200_000.0)])[0])
