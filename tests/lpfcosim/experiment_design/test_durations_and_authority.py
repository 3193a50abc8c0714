"""Designs with free hours and settings, interrupted ones, and what becomes of them elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.campaign.design_spec import LimitSpec
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import (
    SearchProgress,
    authority_selection,
    campaign_text,
    convex_bound,
    duration_allocation,
    robustness,
)
from lpfcosim.experiment_design.cvxpy_problem import TimeBudget
from lpfcosim.experiment_design.design_problem import build_problem, design_problem
from lpfcosim.experiment_design.optimize import design
from lpfcosim.experiment_design.search import search
from tests import ROOT

SILENT = SearchProgress(lambda value, bound: None, lambda step, value: None, lambda share: None)


def with_wishes(problem, **more):
    return replace(problem, plan=replace(problem.plan, design=replace(problem.plan.design, **more)))


def test_commands_stay_within_their_authority(problem):
    for experiment in problem.experiments:
        (limit,) = (limit for limit in experiment.limits if limit.kind == "authority")
        assert limit.quantity == "F_x_2"
        held = abs(experiment.run.dc) * experiment.run.m_tm
        assert limit.value == pytest.approx(experiment.run.authority.F_max_2 - held, rel=0.1)


def test_hours_go_where_they_tell_most(problem, optimum):
    longer = convex_bound.optimize_power(
        problem.experiments,
        problem.prior_information,
        problem.objective,
        (),
        budget=TimeBudget(86400.0, np.full(2, 21600.0)),
    )
    assert longer.durations.sum() == pytest.approx(86400, rel=1e-4)
    assert longer.durations.min() > 21590
    assert 0 <= longer.gap < 5e-3
    # twice the hours tell twice as much, if they are shared out no worse than evenly
    assert longer.bound < optimum.value / np.sqrt(2) * 1.001
    assert longer.bound > optimum.bound / 2


def test_too_few_hours_are_told(problem):
    with pytest.raises(InputError, match=r"design.hours: 9 h are too few, .* last 12 h at the least"):
        duration_allocation.optimize_durations(problem, 9 * 3600.0, SILENT)


def test_an_experiment_does_not_reach_into_the_next(pair):
    first, second = pair.experiments
    prior_information = replace(pair, experiments=(first, replace(second, t0="2016-04-16T22:00:00+00:00")))
    with pytest.raises(InputError, match=r'"A" would reach into "D"'):
        duration_allocation.with_durations(prior_information, {"A": 50000.0})


def test_bands_that_leave_nothing_are_told(problem, fit_model):
    plan = with_wishes(problem, forbidden=((1e-5, 1.0),)).plan
    with pytest.raises(InputError, match=r"design.forbidden: experiment A has no frequency left"):
        build_problem(plan, problem.sigmas_before, problem.baseline_limits, fit_model)


def test_limits_that_close_every_loop_are_told(problem, fit_model):
    caps = tuple(LimitSpec(quantity, "peak", 1e-16) for quantity in ("o_1", "o_12"))
    plan = with_wishes(problem, caps=caps).plan
    with pytest.raises(InputError, match=r"design.limits: peak of o_1 and peak of o_12 so small leave no"):
        build_problem(plan, problem.sigmas_before, problem.baseline_limits, fit_model)


@pytest.mark.parametrize(
    ("most", "sentence"), [(48 * 3600.0, "48"), pytest.param(None, "2000", marks=pytest.mark.slow)]
)
def test_what_no_hours_reach_is_told_before_a_search(pair, fit_model, most, sentence):
    spec = replace(pair.design, goal="least hours", hours=most, sigmas={"omega2_1_0": 1e-13})
    with pytest.raises(InputError, match=rf"design.hours: in {sentence} h no design does, .* omega2_1_0 is"):
        design(replace(pair, design=spec), fit_model, SILENT)


@pytest.mark.slow
def test_settings_that_tell_more_are_found(pair, fit_model):
    allowed = {"F_max_2": (50e-12, 2200e-12), "N_max_1": (1.5e-12, 10.4e-12)}
    problem = design_problem(
        replace(pair, design=replace(pair.design, held="rms", authority=allowed)), fit_model
    )
    first, second = problem.plan.experiments
    near = replace(first.authority, name="near", F_max_2=1500e-12, N_max_1=8e-12)
    near = replace(problem.plan, experiments=(first, replace(second, authority=near)))
    worse = build_problem(near, problem.sigmas_before, problem.baseline_limits, fit_model)
    result = authority_selection.select_authority(worse, fit_model, SILENT)
    a, b = (e.authority for e in result.plan.experiments)
    assert a.N_max_1 != b.N_max_1

    def value(of):
        return convex_bound.optimize_power(
            of.experiments, of.prior_information, of.objective, (), rounds=1
        ).value

    assert value(result) < 0.7 * value(worse)


@pytest.mark.slow
def test_interrupted_it_gives_the_best_so_far(problem, fit_model):
    said = []

    def value(step, reached):
        said.append(reached)
        if step.startswith("trial 2"):
            raise KeyboardInterrupt

    result = search(problem, fit_model, replace(SILENT, on_value=value))
    assert not result.complete
    assert result.sigmas_after.keys() == result.problem.sigmas_before.keys()
    assert result.value < 1
    assert max(x for of in result.limit_ratios.values() for x in of.values()) < 1 + 1e-6

    def at_once(step, reached):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search(problem, fit_model, replace(SILENT, on_value=at_once))


@pytest.mark.long
def test_the_least_hours_reach_what_is_wanted(pair, fit_model):
    result = design(
        replace(pair, design=replace(pair.design, goal="least hours", held="peaks", shortest=21600.0)),
        fit_model,
        SILENT,
    )
    assert result.value <= 1
    assert result.min_duration <= result.duration * (1 + 1e-6)
    assert result.duration == pytest.approx(2 * 21600, rel=1e-3)
    written = campaign_text(result, "soon", "pair.toml")
    assert "[design]" not in written


@pytest.mark.slow
def test_elsewhere_a_design_loses_little(designed, fit_model):
    result, _ = designed
    lost = robustness(result, fit_model, lambda share: None)
    assert -0.01 < lost.loss < 0.1
    assert 0.9 < lost.max_limit_ratio < 1.2


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
