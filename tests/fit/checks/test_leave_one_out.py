"""Leave one out, against fits of the telemetry that remains and the noise of each run; further displays."""

from dataclasses import replace

import numpy as np
import pytest

import fit
from fit.fitting import JointModel
from tests.oracles.synthetic import World, pair


@pytest.fixture(scope="module")
def runs():
    return [run for name in "ABC" for run in pair(World(), name, seed=ord(name), experiment=name)]


@pytest.fixture(scope="module")
def results(runs):
    return fit.calibrate(runs)


def test_without_an_experiment_the_fit_is_that_of_the_others(runs, results):
    check = fit.leave_one_out(results)
    assert set(check.index.get_level_values("without")) == {"A", "B", "C"}
    others = fit.calibrate([run for run in runs if run.experiment != "C"]).joint
    row = check.loc["C", "lambda_2"]
    assert row["value"] == pytest.approx(others["lambda_2"].value, abs=0.3 * row["sigma"])
    assert row["sigma"] == pytest.approx(others["lambda_2"].sigma, rel=0.1)


def test_a_shift_is_in_units_of_the_noise_of_its_difference(results):
    """The estimates move with the noise of each run, one element at a time; their differences add up."""
    solved = results.joint.solved
    reduced = solved.exclude("C")
    variance = 0.0
    for k, run in enumerate(solved.model.runs):
        covariance = np.eye(len(run.root)) + (0 if run.psd_covariance is None else run.psd_covariance)
        for noise in np.linalg.cholesky(covariance).T:
            moved = replace(run, c=run.c + np.linalg.lstsq(run.root, 0.01 * noise, rcond=None)[0])
            changed = replace(
                solved, model=JointModel([*solved.model.runs[:k], moved, *solved.model.runs[k + 1 :]])
            )
            with_c, without_c = changed.refit(solved.result.params), changed.exclude("C")
            shift = without_c.params["lambda_2"].value - with_c.params["lambda_2"].value
            first = reduced.params["lambda_2"].value - solved.result.params["lambda_2"].value
            variance += ((shift - first) / 0.01) ** 2
    row = fit.leave_one_out(results).loc["C", "lambda_2"]
    assert row["shift"] == pytest.approx(first / np.sqrt(variance), rel=1e-3)
    nested = np.sqrt(row["sigma"] ** 2 - results.joint["lambda_2"].sigma ** 2)
    assert np.sqrt(variance) == pytest.approx(nested, rel=0.1)  # the difference of nested estimates
