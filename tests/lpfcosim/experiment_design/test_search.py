"""Designs: bound, tones, forecast, limits, and the file that says all of it."""

from dataclasses import replace

import numpy as np
import pytest

from fit.forecasting.expected_fit import NoneTakesPartError
from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import limits
from lpfcosim.experiment_design.design_problem import design_problem
from lpfcosim.experiment_design.objective import Objective
from lpfcosim.experiment_design.search import search
from lpfcosim.linear import ClosedLoop
from lpfcosim.spacecraft import TaperedSine
from tests import ROOT


def random_value(problem, generator) -> float:
    """Return the objective of a design of random powers at random frequencies, as strong as limits allow."""
    information = problem.base_information.copy()
    for experiment in problem.experiments:
        n = int(generator.integers(1, 12))
        frequency = np.exp(generator.uniform(np.log(4e-4), np.log(0.09), n))
        told, cost = experiment.responses(frequency)
        size = 1 / np.abs(cost).max(axis=1) * generator.exponential(size=(n, told.shape[2]))
        u = size * np.exp(2j * np.pi * generator.uniform(size=size.shape))
        reached = np.sqrt(np.sum(np.abs(np.einsum("nkl,nl->nk", cost, u)) ** 2, axis=0) / 2).max()
        y = np.einsum("npl,nl->np", told, u / reached)
        information += experiment.model.duration * (y.conj().T @ y).real
    return problem.objective.value(problem.objective.logs(information))


def test_no_random_design_beats_the_bound(problem, optimum):
    assert 0 <= optimum.gap < 5e-3
    generator = np.random.default_rng(20161117)
    assert min(random_value(problem, generator) for _ in range(200)) > optimum.bound


@pytest.mark.slow
def test_certificate_is_tight_and_tones_come_near(designed):
    result, said = designed
    assert 0 <= result.optimum.gap < 5e-3
    assert said.bounds[-1] == (result.optimum.value, result.optimum.bound)
    assert len(said.values) > 3
    assert said.shares == sorted(said.shares)
    assert said.shares[0] < 0.2
    assert said.shares[-1] == pytest.approx(1)
    assert max(np.diff(said.shares)) < 0.2  # so that what is left is told as it shrinks
    assert 0.98 < result.efficiency <= 1


@pytest.mark.slow
def test_the_forecast_knows_the_same(designed):
    result, _ = designed
    assert result.sigmas_after.keys() == result.problem.sigmas_before.keys()
    told = np.exp(result.problem.objective.logs(result.solution.information))
    scale = result.problem.experiments[0].scale[result.problem.objective.indices]
    forecast = np.array([result.sigmas_after[name] for name in result.problem.parameters]) / scale
    np.testing.assert_allclose(told, forecast, rtol=1e-2)
    assert all(result.sigma_bounds[name] < result.sigmas_after[name] for name in result.problem.parameters)


@pytest.mark.slow
def test_limits_are_kept_by_the_reference_plant(designed):
    result, _ = designed
    runs = {run.experiment: run for run in result.campaign.runs if run.kind == "sysid"}
    for experiment in result.problem.experiments:
        run = replace(runs[experiment.run.experiment], noise=type(experiment.run.noise)(), dc=0.0)
        moved = ClosedLoop(run).simulate()
        of = {
            "o_1": moved["o_1"],
            "o_12": moved["o_12"],
            "F_x_2": moved["f_x_2"] * run.m_tm,
            "F_x_sc": moved["F_x_sc"],
        }
        reached = {q: np.sqrt(np.mean(x**2)) for q, x in of.items()}
        shares = [reached[limit.quantity] / limit.value for limit in experiment.active_limits]
        assert max(shares) == pytest.approx(1, abs=1e-3)


@pytest.mark.slow
def test_few_tones_begin_and_end_together(designed):
    result, _ = designed
    for tones in result.tones.values():
        injections = [tone.injection for tone in tones]
        assert all(isinstance(i, TaperedSine) for i in injections)
        assert len({(i.start, i.ramp, round(i.end, 6)) for i in injections}) == 1
        for into in ({"guidance_o_1"}, {"guidance_o_12", "F_x_2"}):
            assert 0 < len([i for i in injections if i.into in into]) <= 4
        f = sorted({i.frequency for i in injections})
        assert min(np.diff(f)) > 1.9e-4


@pytest.mark.slow
def test_the_worst_ratio_is_bounded_too(problem):
    from lpfcosim.experiment_design import convex_bound

    mean = problem.objective
    worst = Objective(mean.indices, mean.weights, minimax=True, max_ratios=mean.max_ratios)
    result = convex_bound.optimize_power(problem.experiments, problem.prior_information, worst, ())
    assert result.gap < 5e-3
    assert result.bound < np.exp(max(worst.logs(result.information))) < 1


def test_what_no_design_reaches_is_told_with_how_near_one_comes(problem, fit_model):
    asked = replace(problem.objective, max_ratios=np.full(problem.objective.max_ratios.size, 0.3))
    with pytest.raises(InputError, match=r"design.no_worse: 0.3 is beyond reach.*stays at 0\.9.*limit"):
        search(replace(problem, objective=asked), fit_model, None)


def test_mistakes_are_one_sentence(pair, fit_model):
    def asked(**more):
        return design_problem(replace(pair, design=replace(pair.design, **more)), fit_model)

    with pytest.raises(InputError, match=r"design.weights: the fit does not determine lambda_3, did you"):
        asked(weights={"lambda_3": 2.0})
    still = replace(pair, experiments=tuple(replace(e, injections=()) for e in pair.experiments))
    with pytest.raises(InputError, match="there is nothing to free"):
        design_problem(still, fit_model)
    short = replace(pair, experiments=tuple(replace(e, n_samples=60000) for e in pair.experiments))
    with pytest.raises(NoneTakesPartError):
        design_problem(short, fit_model)


def test_without_the_solver_one_sentence_tells_what_to_install(monkeypatch):
    from lpfcosim.experiment_design import cvxpy_problem

    monkeypatch.setitem(__import__("sys").modules, "cvxpy", None)
    with pytest.raises(InputError, match=r"pip install 'lpfcosim\[design\]'"):
        cvxpy_problem.solver()


@pytest.mark.slow
def test_limits_of_its_own_are_what_tones_reach(pair):
    run = pair.runs[1]
    result = {
        limit.name: limit.value for limit in limits.baseline_limits(run, [("o_1", "peak"), ("F_x_sc", "rms")])
    }
    moved = ClosedLoop(replace(run, noise=type(run.noise)())).simulate()
    assert result["peak of o_1"] == pytest.approx(np.max(np.abs(moved["o_1"])), rel=1e-6)
    assert result["rms of F_x_sc"] == pytest.approx(np.sqrt(np.mean(moved["F_x_sc"] ** 2)), rel=1e-6)


@pytest.mark.parametrize(
    ("said", "wrong"),
    [
        ('held = "all"', r"design.held: .*peaks and rms of thrust"),
        ("sines = 0", r"design.sines: "),
        ('forbidden = [["11 mHz", "9 mHz"]]', r"design.forbidden: a band from 0.011 Hz"),
        ('[design.limits.o_1]\npeak = "10 pN"', r"design.limits: .*10 pN.*is not a length"),
        ('[design.limits.o_1]\npeak = "40 %"', r"design.limits: .*only peaks of F_x_1 and F_x_2"),
        ('[design.limits.F_x_2]\npeak = "140 %"', r"design.limits: .*no share"),
        ('[design.limits.F_x_2]\ntop = "40 %"', r"design.limits.F_x_2.top: unknown key"),
    ],
)
def test_wishes_are_checked(said, wrong, tmp_path):
    head = "" if said.startswith("[") else "[design]\n"
    path = tmp_path / "c.toml"
    base = (ROOT / "campaigns" / "quickstart.toml").as_posix()
    path.write_text(f'extends = "{base}"\n{head}{said}\n', encoding="utf-8")
    with pytest.raises(InputError, match=wrong):
        loading.load(path)
