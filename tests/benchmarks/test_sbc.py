"""The machinery of the simulation-based calibration; what it finds is for the page to tell."""

import csv
import json

import numpy as np
import pytest
from scipy.stats import norm

from tests import ROOT
from tests.benchmarks import sbc

NAMES = tuple(sbc.thirteen.TRUTH)[:-1]


def line(number, pulls, sigma=1e-3, **fit):
    ranks = {name: float(norm.cdf(-pull)) for name, pull in pulls.items()}
    kept = {"pulls": pulls, "ranks": ranks, "sigmas": dict.fromkeys(pulls, sigma), "unsound": [], "runs": []}
    return {"number": number, "fit": {**kept, **fit}}


@pytest.fixture(scope="module")
def right():
    """What 400 fits with true sigmas would leave."""
    rng = np.random.default_rng(3)
    return [
        line(i, dict(zip(NAMES, rng.standard_normal(len(NAMES)).tolist(), strict=True))) for i in range(400)
    ]


def outside(lines):
    """Return by model how many parameters stray farther than 95 % of sets of all of them do."""
    found = sbc.rows(sbc.models(lines))
    limit = 1 - 0.95 ** (1 / len(NAMES))
    return {
        model: sum(float(row[7]) < limit for row in found if row[0] == model)
        for model in dict.fromkeys(row[0] for row in found)
    }


@pytest.mark.stat
def test_right_ranks_pass_and_wrong_models_do_not(right):
    found = outside(right)
    assert found["the fit"] == 0
    assert found["delays off by half a sample"] == 2
    half_as_sure = [
        line(one["number"], {k: v / 0.8 for k, v in one["fit"]["pulls"].items()}) for one in right
    ]
    assert outside(half_as_sure)["the fit"] > 3
    # the width of the other scatters: lambda_1 alone is too sure
    scattered = [
        line(one["number"], {k: v * (3 if k == "lambda_1" else 1) for k, v in one["fit"]["pulls"].items()})
        for one in right
    ]
    rigid = [{**one, "rigid": two["fit"]} for one, two in zip(right, scattered, strict=True)]
    assert outside(rigid)["scatter not modelled"] == 1


def test_what_is_not_sound_or_failed_is_counted_and_not_ranked(right):
    lines = [*right[:30], line(30, {"lambda_1": 100.0}, unsound=["contradiction"])]
    lines.append({"number": 31, "fit": {"failed": "no noise"}})
    table = sbc.rows(sbc.models(lines))
    assert {row[2] for row in table} == {"30"}
    assert "Of 32 campaigns, 1 have no joint fit, and 1 have one whose uncertainties are" in sbc.section(
        lines, table
    )


def test_a_log_is_continued_and_that_of_another_fit_refused(tmp_path, right):
    log, head = tmp_path / "log.jsonl", {"seed": 1, "sources": "a"}
    assert sbc.known(log, head) == []
    with log.open("a") as file:
        file.write(json.dumps(right[0]) + "\n" + json.dumps(right[1])[:50])  # killed while it wrote
    assert sbc.known(log, head) == [right[0]]
    assert sbc.known(log, head) == [right[0]]
    with pytest.raises(SystemExit, match="of another seed, prior or fit"):
        sbc.known(log, {**head, "sources": "b"})


@pytest.mark.long
def test_a_campaign_depends_on_its_number_alone():
    first, second = sbc.trial(10), sbc.trial(10)
    assert first == second
    assert first["fit"]["scatter"]
    assert set(first["fit"]["ranks"]) == set(NAMES)
    assert not first["rigid"].get("scatter")
    assert "rigid" not in sbc.trial(11)


def test_the_page_has_the_numbers_of_the_file():
    with (ROOT / "docs" / "sbc.csv").open(encoding="utf-8") as file:
        lines = [row for row in csv.DictReader(file) if row["model"] == "the fit"]
    page = (ROOT / "docs" / "validation.md").read_text(encoding="utf-8")
    assert {row["parameter"] for row in lines} == set(NAMES)
    means, shares = ([float(row[key]) for row in lines] for key in ("mean", "within_68"))
    assert f"{min(means):+.2f} to {max(means):+.2f}" in page
    assert f"contain {100 * min(shares):.1f} to {100 * max(shares):.1f} %" in page
