"""Campaigns repeated: statistics, seeds, resuming, and the verdict."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import lpfcosim
from fit.forecasting import coverage
from fit.settings import settings
from fit.spacecraft.lisa import GEOMETRY
from lpfcosim.campaign import loading, montecarlo
from lpfcosim.cosim import SimulationProgress
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import Workers
from lpfcosim.workflows.montecarlo_trial import MonteCarloTask, misaligned
from tests import ROOT
from tests.campaign_text import campaign

SMALL = campaign(
    'duration = "6 h"\nnoise_duration = "6 h"',
    ("guidance_o_12", "1 mHz", "10 nm", 6, "900 s"),
    ("guidance_o_12", "10 mHz", "5 nm", 40, "7000 s"),
    ("guidance_o_1", "5 mHz", "10 nm", 40, "12000 s"),
    name="small",
    seed=3,
)


@pytest.fixture
def small(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(SMALL, encoding="utf-8")
    return path


def test_pulls_of_a_known_distribution():
    rng = np.random.default_rng(5)
    drawn = [{"a": (0.3 + 1.2 * x, 2.0), "b": (y, 1.0)} for x, y in rng.standard_normal((4000, 2))]
    drawn += [{"b": (0.0, 1.0)}]
    result = coverage.summary(drawn)
    a = result["a"]
    assert (a.n, result["b"].n, a.sigma) == (4000, 4001, 2.0)
    assert abs(a.pull_mean - 0.3) < 4 * a.pull_mean_error
    assert abs(a.pull_std - 1.2) < 4 * a.pull_std_error
    inside = norm.cdf(0.7 / 1.2) - norm.cdf(-1.3 / 1.2)
    assert abs(a.coverage_1sigma - inside) < 4 * a.coverage_1sigma_error
    assert a.pull_mean_error == pytest.approx(1.2 / 4000**0.5, rel=0.05)
    assert coverage.summary(drawn[:1]) == {}


@pytest.mark.parametrize("j", [1, 2])
def test_telemetry_from_spectra_knows_no_limit_of_torques(small, j):
    text = SMALL.replace("tail = 1.5", 'tail = 1.5\ndws = "150 nrad Hz^-0.5"')
    text = text.replace("[noise]", 'spacecraft = "lpf"\n[noise]', 1)
    small.write_text(text.replace(f'N_max_{j} = "10.4', f'N_max_{j} = "0.01'), encoding="utf-8")
    with pytest.raises(InputError, match=f"N_phi_{j} is expected beyond its limit of 1e-14"):
        lpfcosim.montecarlo(small, 2)


def test_a_command_at_its_limit_is_no_campaign_that_counts(small):
    small.write_text(SMALL.replace('"2200 pN"', '"0.5 pN"'), encoding="utf-8")
    task = MonteCarloTask(loading.load(small), settings(), redraw=False)
    assert "f_x_2 reaches its limit" in task.run(1, SimulationProgress())["failed"]


def test_every_number_has_noise_of_its_own_and_truths_that_stay_near_and_valid(small):
    plan = loading.load(small)
    numbered = [montecarlo.numbered(plan, k, redraw=False) for k in range(50)]
    assert len({drawn.seed for drawn in numbered}) == 50
    assert numbered[7] == montecarlo.numbered(plan, 7, redraw=False)
    assert numbered[7].truth == plan.truth
    plan = replace(plan, truth={**plan.truth, "C_1": 0.06})  # a delay near the shortest, half the hold
    truths = [montecarlo.numbered(plan, k, redraw=True).truth for k in range(200)]
    for name, reach in (("lambda_1", 0.05), ("omega2_1_0", 0.3), ("alpha_x_2", 0.3), ("C_2", 0.3)):
        ratio = np.array([t[name] / plan.truth[name] for t in truths])
        assert 0.9 * reach < abs(ratio - 1).max() <= reach
    assert min(min(t["C_1"] / t["lambda_1"], t["C_2"] / t["lambda_2"]) for t in truths) > 0.05
    assert len({t["delta_ifo_1"] for t in truths}) == 200


def test_axes_of_lisa_are_drawn_unless_they_are_stated():
    lisa = loading.load(ROOT / "campaigns" / "lisa.toml")
    drawn = [misaligned(montecarlo.numbered(lisa, k, redraw=False)).truth for k in range(400)]
    axes = np.array([[truth[name] for name in GEOMETRY] for truth in drawn])
    np.testing.assert_allclose(axes.std(axis=0), 1e-3, rtol=0.15)  # 4 sigma
    stated = replace(lisa, fit={"parameters": {"opening": {"value": 0.0, "vary": False}}})
    assert misaligned(stated).truth.keys() >= {"o_per_y_1"}
    assert "opening" not in misaligned(stated).truth


@pytest.mark.slow
def test_the_command_leaves_what_the_contract_says_and_continues(small, tmp_path, lpfcosim):
    once, twice = tmp_path / "once", tmp_path / "twice"
    out = lpfcosim("montecarlo", small, "-n", 4, "--out", once, "--jobs", 2, status=0)[1]
    assert "lambda_2" in out
    document = json.loads((once / "montecarlo.json").read_text(encoding="utf-8"))
    assert (document["schema"], document["n"], document["failed"]) == ("lpf-montecarlo/1", 4, {})
    assert {"pull_mean", "pull_std", "coverage_1sigma"} <= document["parameters"]["lambda_2"].keys()
    assert abs(document["parameters"]["lambda_2"]["pull_mean"]) < 2.5
    assert (once / "figures" / "pulls.svg").stat().st_size > 1000

    lpfcosim("montecarlo", small, "-n", 2, "--out", twice, "--jobs", 1, "--quiet", status=0)
    log = twice / "campaigns.jsonl"
    log.write_text(log.read_text(encoding="utf-8") + '{"number": 2, "est', encoding="utf-8")  # killed
    lpfcosim("montecarlo", small, "-n", 4, "--out", twice, "--jobs", 1, "--quiet", status=0)
    again = json.loads((twice / "montecarlo.json").read_text(encoding="utf-8"))
    assert again == document  # neither interruption nor number of processes counts
    error = lpfcosim("montecarlo", small, "-n", 4, "--out", twice, "--redraw", status=2)[2]
    assert "expected another folder" in error


def test_pulls_that_chance_explains_are_valid_and_others_are_not():
    """Of 500 studies of sound calibrations at most 1 % are called invalid: 13 or more come in one of 1000."""
    rng = np.random.default_rng(11)
    names = ("lambda_2", "C_2", "omega2_2_0")

    def verdict(n, failed=0, mean=0.0, std=1.0):
        drawn = [{name: (mean + std * rng.standard_normal(), 1.0) for name in names} for _ in range(n)]
        return coverage.verdict(coverage.summary(drawn), n, failed)

    assert sum(not verdict(n).valid for n in (2, 3, 10, 50, 200) for _ in range(100)) < 5
    for n, mean, std in ((200, 2.2, 1), (200, 0.5, 1), (20, 2.2, 1), (100, 0, 1.5), (100, 0, 0.6)):
        assert not verdict(n, mean=mean, std=std).valid
    assert verdict(99, failed=1).valid
    assert verdict(4, failed=1).valid
    assert verdict(90, failed=10).reasons == ("10 of 100 failed, of sound ones 1 % may",)


@pytest.mark.parametrize(("mean", "valid"), [(0.0, True), (2.2, False)])
def test_a_study_ends_with_its_verdict(small, tmp_path, monkeypatch, mean, valid):
    rng = np.random.default_rng(3)
    lines = [{"number": k, "estimates": {"C_2": (mean + rng.standard_normal(), 1.0)}} for k in range(40)]
    monkeypatch.setattr(Workers, "results", lambda *_: (("", line) for line in lines))
    study = lpfcosim.montecarlo(small, 40, tmp_path / "out")
    assert study.document()["verdict"]["valid"] == valid
    if valid:
        study.check_valid()
        assert study.notes[-1].startswith("valid: pulls and coverage of 1 parameter are consistent")
    else:
        with pytest.raises(RunError, match=r"^small: not valid: C_2: mean pull 2\."):
            study.check_valid()
