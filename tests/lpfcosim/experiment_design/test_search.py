"""Designs: bound, tones, forecast and limits."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from fit.settings import settings
from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import FitModel, convex_bound, design_problem, limits, search
from lpfcosim.linear import ClosedLoop
from lpfcosim.spacecraft import Sine
from tests import ROOT
from tests.lpfcosim.experiment_design.conftest import with_keys


def random_information(problem, generator):
    """Return the information of random powers at random frequencies, as strong as limits allow."""
    information = problem.base_information.copy()
    for experiment in problem.experiments:
        n = int(generator.integers(1, 12))
        frequency = np.exp(generator.uniform(np.log(4e-4), np.log(0.09), n))
        sensitivity, cost = experiment.responses(frequency)
        size = 1 / np.abs(cost).max(axis=1) * generator.exponential(size=(n, sensitivity.shape[2]))
        u = size * np.exp(2j * np.pi * generator.uniform(size=size.shape))
        reached = np.sqrt(np.sum(np.abs(np.einsum("nkl,nl->nk", cost, u)) ** 2, axis=0) / 2).max()
        y = np.einsum("npl,nl->np", sensitivity, u / reached)
        information += experiment.model.duration * (y.conj().T @ y).real
    return information


def test_no_random_design_beats_the_bounds(problem, optimum):
    assert optimum.bound < optimum.value < 1.01 * optimum.bound
    generator = np.random.default_rng(20161117)
    for _ in range(200):
        information = random_information(problem, generator)
        assert problem.objective.value(information) > optimum.bound
        sigmas = np.sqrt(np.diag(np.linalg.inv(information))[problem.objective.indices])
        assert np.all(sigmas > optimum.sigma_bounds)


@pytest.mark.slow
def test_tones_come_near_the_bound_and_the_forecast_says_the_same(designed):
    assert designed.complete
    assert 0.98 < designed.efficiency <= 1
    assert designed.sigmas_after.keys() == designed.problem.sigmas_before.keys()
    assert designed.value == pytest.approx(designed.optimum.value, rel=0.02)
    for name in designed.problem.parameters:
        assert 0 < designed.sigma_bounds[name] < designed.sigmas_after[name]


@pytest.mark.slow
def test_limits_are_kept_by_the_reference_plant(designed):
    runs = {run.experiment: run for run in designed.campaign.runs if run.kind == "sysid"}
    for experiment in designed.problem.experiments:
        run = replace(runs[experiment.run.experiment], noise={}, dc=0.0)
        moved = limits.quantities(run, ClosedLoop(run).simulate())
        ratios = limits.limit_ratios(run, experiment.active_limits, moved)
        assert max(ratios.values()) == pytest.approx(1, abs=1e-3)


@pytest.mark.slow
def test_few_tones_begin_and_end_together(designed):
    for tones in designed.tones.values():
        injections = [tone.injection for tone in tones]
        assert all(isinstance(i, Sine) for i in injections)
        assert len({(i.start, i.ramp, round(i.end, 6)) for i in injections}) == 1
        for into in ({"guidance_o_1"}, {"guidance_o_12", "F_x_2"}):
            assert 0 < len([i for i in injections if i.into in into]) <= 4
        f = sorted({i.frequency for i in injections})
        assert min(np.diff(f)) > 1.9e-4


@pytest.mark.long
def test_tones_within_peaks_reduce_the_sigmas_to_less_than_two_fifths(fit_model):
    plan = with_keys(loading.load(ROOT / "campaigns" / "quickstart.toml"), held="peaks", sines=12)
    model = FitModel(plan, settings(plan.fit, "fit"))
    found = search(design_problem(plan, model), model, lambda *_: None, lambda *_: None)
    assert found.optimum.bound < found.value <= 0.38
    for experiment in found.problem.experiments:
        (run,) = (
            r for r in found.campaign.runs if (r.kind, r.experiment) == ("sysid", experiment.run.experiment)
        )
        ratios = limits.limit_ratios(run, experiment.active_limits, limits.tone_response(run))
        assert max(ratios.values()) == pytest.approx(1, abs=1e-6)


@pytest.mark.slow
def test_interrupted_it_gives_the_best_so_far(problem, fit_model):
    steps = iter(["first"])

    def interrupt_second(step, value):
        if not next(steps, None):
            raise KeyboardInterrupt

    result = search(problem, fit_model, lambda value, bound: None, interrupt_second)
    assert not result.complete
    assert result.sigmas_after.keys() == result.problem.sigmas_before.keys()
    assert result.value < 1


@pytest.mark.slow
def test_the_redesigned_mission_is_what_it_says(fit_model):
    sigmas_before, sigmas_after = (
        fit_model.sigmas(loading.load(ROOT / "campaigns" / f"{name}.toml"))
        for name in ("mission-x", "designed")
    )
    assert sigmas_after.keys() == sigmas_before.keys()
    ratios = np.array([sigmas_after[name] / sigmas_before[name] for name in sigmas_before])
    assert ratios.max() < 1
    assert np.exp(np.mean(np.log(ratios))) == pytest.approx(0.4759, rel=1e-3)


def test_commands_stay_within_their_authority(problem):
    for experiment in problem.experiments:
        (limit,) = (limit for limit in experiment.limits if limit.kind == "authority")
        assert limit.quantity == "F_x_2"
        held = abs(experiment.run.dc) * experiment.run.m_tm
        assert limit.value == pytest.approx(experiment.run.authority.F_max_2 - held, rel=0.1)


def test_what_cannot_be_designed_is_one_sentence(pair, fit_model, monkeypatch):
    still = replace(pair, experiments=tuple(replace(e, injections=()) for e in pair.experiments))
    for plan, message in (
        (with_keys(pair, weights={"lambda_3": 2.0}), "design.weights: .* determine lambda_3, did you"),
        (still, "no loop may be driven: expected tones in the campaign"),
    ):
        with pytest.raises(InputError, match=message):
            design_problem(plan, fit_model)
    problem = design_problem(with_keys(pair, forbidden=[[1e-5, 1.0]]), fit_model)
    with pytest.raises(InputError, match=r"design.forbidden: experiment A has no frequency left"):
        convex_bound.optimize_power(problem)
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    with pytest.raises(InputError, match=r"pip install 'lpfcosim\[design\]'"):
        convex_bound.solver()


def test_baseline_limits_are_what_the_tones_reach(pair):
    injections = (pair.runs[1].injections[0], Sine("guidance_o_1", 5e-9, 0.01, 20, 1000.0))
    run = replace(pair.runs[1], n_samples=60_000, injections=injections)
    baseline = limits.baseline_limits(run, [("o_1", "peak"), ("F_x_sc", "rms")])
    reached = {limit.name: limit.value for limit in baseline}
    moved = ClosedLoop(replace(run, noise={})).simulate()
    assert reached["peak of o_1"] == pytest.approx(np.max(np.abs(moved["o_1"])), rel=1e-6)
    assert reached["rms of F_x_sc"] == pytest.approx(np.sqrt(np.mean(moved["F_x_sc"] ** 2)), rel=1e-6)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('[design]\nforbidden = [["11 mHz", "9 mHz"]]', r"design.forbidden: a band from 0.011 Hz"),
        ('[design.limits.o_1]\npeak = "10 pN"', r"design.limits: .*10 pN.*has another unit"),
        ('[design.limits.o_1]\npeak = "40 %"', r"design.limits: .*only peaks of F_x_1 and F_x_2"),
        ('[design.limits.F_x_2]\npeak = "140 %"', r"design.limits: .*no share"),
    ],
)
def test_keys_are_checked(table, message, tmp_path):
    path = tmp_path / "c.toml"
    base = (ROOT / "campaigns" / "quickstart.toml").as_posix()
    path.write_text(f'extends = "{base}"\n{table}\n', encoding="utf-8")
    with pytest.raises(InputError, match=message):
        loading.load(path)
