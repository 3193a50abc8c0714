"""Which runs are left out, on compressed runs drawn at random."""

from dataclasses import replace

import numpy as np
import pytest

from fit.checks.leverage import find_leverages, pull_limit
from fit.statistics.outlier_runs import find_outlier_runs, is_contradicted
from fit.statistics.scatter import estimate_scatter
from tests.fit.statistics.runs import SCALE, P, consistency, scattered, shifted

NAMES = ("lambda_1", "lambda_2", "C_1", "C_2")


def with_parameter_map(run, parameter_map):
    """Return a run with another map from the joint parameters to its own."""
    equation = replace(run.equation, parameter_map=parameter_map)
    return replace(run, estimate=replace(run.estimate, equation=equation), equation=equation)


@pytest.mark.parametrize("bad", [(3,), (0, 2, 8)])
def test_bad_runs_are_left_out(bad):
    test = consistency(1, 9, bad)
    outliers = find_outlier_runs(test)
    assert outliers.runs == tuple(f"run {i}" for i in bad)
    assert test.without(bad).total.p > 0.01
    for name, p in outliers.probabilities.items():
        assert p > 0.999 if name in outliers.runs else p < 0.01


def test_most_probable_subset_grows_beyond_the_enumerated_ones(monkeypatch):
    monkeypatch.setattr("fit.statistics.outlier_runs.MAX_SUBSETS", 12)
    assert find_outlier_runs(consistency(1, 9, (0, 2, 8))).runs == ("run 0", "run 2", "run 8")


def test_a_run_without_any_noise_leaves_an_answer():
    test = consistency(1, 5, (3,), shift=1e30)
    assert find_outlier_runs(test).answers


@pytest.mark.parametrize(("n_runs", "bad"), [(6, (0, 1, 2)), (2, (0,))])
def test_half_of_the_runs_contradict_the_others(n_runs, bad):
    test = consistency(3, n_runs, bad, shift=1e4)
    outliers = find_outlier_runs(test)
    assert is_contradicted(test)
    assert len(outliers.runs) < n_runs / 2


def test_a_suspect_is_tested_with_a_limit_of_its_own():
    for shift in np.arange(0.0, 20.0, 0.1):
        test = consistency(1, 13, (3,), shift=shift)
        if is_contradicted(test, suspects=["run 3"]):
            break
    assert not is_contradicted(test)
    assert test.of_runs([3]).p > 1e-5


def only_in(test, numbers):
    """Return the test where only some runs determine the first parameter."""
    shares = [run.equation.parameter_map.copy() for run in test.runs]
    for i, share in enumerate(shares):
        share[:, 0] *= i in numbers
    runs = [with_parameter_map(run, share) for run, share in zip(test.runs, shares, strict=True)]
    return replace(test, runs=tuple(runs))


def of_label(test, numbers):
    """Return the test where the first parameter is the coefficient of lambda_1 of some runs."""
    runs = []
    for i, run in enumerate(test.runs):
        share = run.equation.parameter_map.copy()
        share[0], share[1:, 0] = (np.arange(P) == 0) * (i in numbers), 0.0
        runs.append(with_parameter_map(run, share))
    return replace(test, runs=tuple(runs))


def moved(test, numbers, amount):
    """Return the test where the first parameter has another value in some runs."""
    runs = [
        shifted(run, amount * SCALE * run.equation.parameter_map[:, 0]) if i in numbers else run
        for i, run in enumerate(test.runs)
    ]
    return replace(test, runs=tuple(runs))


def test_of_two_runs_that_may_equally_well_be_bad_both_are_left_out():
    outliers = find_outlier_runs(moved(only_in(consistency(1, 7), (0, 1)), (0,), 1e3))
    assert outliers.runs == ("run 0", "run 1")
    assert set(outliers.answers) == {("run 0",), ("run 1",)}


@pytest.mark.parametrize("seed", range(8))
def test_the_fewest_runs_are_bad(seed):
    test = moved(only_in(consistency(seed, 13), (0, 1, 2)), (2,), 1e3)
    assert find_outlier_runs(test).runs == ("run 2",)


@pytest.mark.parametrize("seed", range(8))
def test_two_runs_against_two_are_not_decided_and_both_answers_are_given(seed):
    outliers = find_outlier_runs(moved(only_in(consistency(seed, 13), (0, 1, 2, 3)), (2, 3), 1e3))
    assert not outliers.runs
    assert {("run 0", "run 1"), ("run 2", "run 3")} <= set(outliers.answers)


@pytest.mark.parametrize(("seed", "width"), [(12, 1.5), (18, 2.0)])
def test_scatter_is_more_likely_than_bad_runs_where_gains_scatter(seed, width):
    test = scattered(seed, 8, width)
    scatter = estimate_scatter(test, NAMES)
    assert scatter.log_likelihood > find_outlier_runs(test).log_odds


def test_bad_run_is_more_likely_than_scatter_where_one_run_is_bad():
    test = consistency(5, 9, (4,))
    assert find_outlier_runs(test).log_odds > estimate_scatter(test, NAMES).log_likelihood


@pytest.mark.stat  # 60 campaigns, false alarms below 2e-4 each: one by chance in 1e-2, two in 1e-4
def test_noise_is_neither_contradiction_nor_scatter():
    groups = {frozenset({"run 0", "run 1", "run 2"}), frozenset({"run 2", "run 3", "run 4"})}
    tests = [consistency(seed, 7) for seed in range(100, 160)]
    assert sum(is_contradicted(test, groups) for test in tests) < 2
    assert sum(estimate_scatter(test, NAMES).p < 1e-5 for test in tests) < 2


def leverages_of_first(test, left_out=()):
    leverages = find_leverages(test, np.zeros(P, dtype=bool), left_out)
    limit = pull_limit(leverages)
    return {x.run: x.contradicting(limit) for x in leverages if x.index == 0 and x.is_high}


@pytest.mark.stat
def test_pulls_of_others_are_in_units_of_their_noise():
    # some 1300 pulls of 300 campaigns; the other sign of a variance makes it 0.6
    tests = [consistency(seed, 3) for seed in range(300)]
    found = [x for test in tests for x in find_leverages(test, np.zeros(P, dtype=bool)) if not x.is_high]
    assert np.mean([x.pulls[""] ** 2 for x in found]) == pytest.approx(1, abs=0.2)


def test_what_one_run_determines_rests_on_it():
    test = only_in(consistency(6, 5), (0,))
    assert leverages_of_first(test) == {"run 0": {}}
    # a run that was left out, and determines it too
    (left_out,) = moved(of_label(consistency(7, 5), (0,)), (0,), 1e3).runs[:1]
    assert set(leverages_of_first(test, [left_out])["run 0"]) == {left_out.name}


def test_weak_runs_contradict_the_strong_one_in_the_parameter_of_their_label():
    test = of_label(consistency(8, 9), (0, 1, 2, 3))
    estimate = test.runs[0].estimate
    precise = replace(estimate, root=20 * estimate.root, c=estimate.c / 20)
    test = replace(test, runs=(replace(test.runs[0], estimate=precise), *test.runs[1:]))
    assert leverages_of_first(test) == {"run 0": {}}
    sigma = float(np.sqrt(test.without((0,)).covariance()[0, 0]))
    contradicted = moved(test, (0,), 4 * sigma)
    assert not is_contradicted(contradicted)
    assert leverages_of_first(contradicted)["run 0"]
