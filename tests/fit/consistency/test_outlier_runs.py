"""Which runs are left out, on compressed runs drawn at random."""

from dataclasses import replace

import numpy as np
import pytest

from fit.consistency.outlier_runs import find_outlier_runs, is_contradicted, leverage
from fit.consistency.scatter import estimate_scatter
from tests.fit.consistency.runs import SCALE, P, consistency, scattered

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
    monkeypatch.setattr("fit.consistency.outlier_runs.MAX_SUBSETS", 12)
    assert find_outlier_runs(consistency(1, 9, (0, 2, 8))).runs == ("run 0", "run 2", "run 8")


@pytest.mark.parametrize(("n_runs", "bad"), [(6, (0, 1, 2)), (2, (0,))])
def test_half_of_the_runs_contradict_the_others(n_runs, bad):
    test = consistency(3, n_runs, bad, shift=1e4)
    outliers = find_outlier_runs(test)
    assert is_contradicted(test)
    assert len(outliers.runs) < n_runs / 2


def test_group_counts_as_one_reason():
    groups = {frozenset({"run 0", "run 1", "run 2"})}
    test = consistency(1, 9, (0, 1, 2), shift=6.0)
    ungrouped, grouped = find_outlier_runs(test), find_outlier_runs(test, groups)
    assert grouped.log_odds > ungrouped.log_odds
    assert find_outlier_runs(consistency(2, 7, (1,)), groups).runs == ("run 1",)


def test_a_group_is_left_out_where_it_may_as_well_be_bad_as_some_of_its_runs():
    groups = {frozenset({"run 0", "run 1", "run 2"})}
    test = consistency(3, 9, (0, 1), shift=30.0)  # log odds of group to runs: -5.7
    assert find_outlier_runs(test).runs == ("run 0", "run 1")
    assert find_outlier_runs(test, groups).runs == ("run 0", "run 1", "run 2")
    assert find_outlier_runs(consistency(4, 9, (0, 1), shift=30.0), groups).runs == ("run 0", "run 1")


def test_of_two_runs_that_may_equally_well_be_bad_both_are_left_out():
    # these two alone determine the first parameter
    test = consistency(1, 7)
    shares = [
        run.equation.parameter_map * (np.arange(P) > 0 if i > 1 else 1.0) for i, run in enumerate(test.runs)
    ]
    runs = [with_parameter_map(run, share) for run, share in zip(test.runs, shares, strict=True)]
    estimate = runs[0].estimate
    runs[0] = replace(runs[0], estimate=replace(estimate, c=estimate.c + 1e3 * SCALE * shares[0][:, 0]))
    outliers = find_outlier_runs(replace(test, runs=tuple(runs)))
    assert outliers.runs == ("run 0", "run 1")


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
    groups = {frozenset({"run 0", "run 1"}), frozenset({"run 2", "run 3"})}
    tests = [consistency(seed, 5) for seed in range(100, 160)]
    assert sum(is_contradicted(test, groups) for test in tests) < 2
    assert sum(estimate_scatter(test, NAMES).p < 1e-5 for test in tests) < 2


def test_what_one_run_determines_rests_on_it():
    test = consistency(6, 5)
    runs = tuple(
        with_parameter_map(run, run.equation.parameter_map * (np.arange(P) > 0)) if i else run
        for i, run in enumerate(test.runs)
    )
    growth = leverage(replace(test, runs=runs), np.zeros(P, dtype=bool))
    assert 0 in growth["run 0"]
    assert not any(0 in places for name, places in growth.items() if name != "run 0")
