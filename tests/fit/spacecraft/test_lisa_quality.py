"""What LISA inherits of the tests of the data: one pipeline judges every spacecraft."""

from dataclasses import replace

import numpy as np
import pytest

import fit
from tests.oracles import lisa_loop
from tests.oracles.lisa_loop import WORLD, pulls


@pytest.fixture(scope="module")
def more(campaign):
    """Two experiments, and a third with its noise run."""
    B, C = (
        lisa_loop.campaign(WORLD, lisa_loop.sequence(1e-6), seed=k, name=n) for k, n in ((1, "B"), (2, "C"))
    )
    return [*campaign, *B], C


def changed(run, **factors):
    return replace(run, channels={**run.channels, **{n: x * run.channels[n] for n, x in factors.items()}})


def test_an_experiment_that_contradicts_the_others_is_left_out(more):
    others, (driven, noise) = more
    results = fit.calibrate([*others, changed(driven, grs_y_1=1.005), noise])
    assert results.provenance.joint_runs == ["A-sysid", "B-sysid"]
    assert not results.joint.unsound
    assert pulls(results.joint).max() < 3.5


def test_a_gain_that_differs_in_one_experiment_scatters(more):
    others, (driven, noise) = more
    joint = fit.calibrate([*others, changed(driven, F_y_1=1.005), noise]).joint
    assert "random_effects" in {w.code for w in joint.warnings}
    assert joint["lambda_y_1"].sigma > 1e-3
    assert pulls(joint).max() < 3.5


def test_another_level_of_the_noise_run_is_marginalised(campaign):
    driven, noise = campaign
    quiet = changed(noise, **dict.fromkeys(lisa_loop.OUTPUTS[:4] + lisa_loop.OUTPUTS[5:7], 0.7))
    joint = fit.calibrate([driven, quiet]).joint
    assert "marginalised_noise" in {w.code for w in joint.warnings}
    assert not joint.unsound
    assert pulls(joint).max() < 3.5


def test_a_glitch_is_masked(campaign):
    driven, noise = campaign
    t = np.maximum(np.arange(driven.size) - 12000.0, 0)  # 50 pm/s that decay in 100 s
    moved = driven.channels["o_2"] + 5e-9 * (1 - np.exp(-t / 100))
    joint = fit.calibrate([replace(driven, channels={**driven.channels, "o_2": moved}), noise]).joint
    assert "glitches" in {w.code for w in joint.warnings}
    assert not joint.unsound
    assert pulls(joint).max() < 3.5


@pytest.mark.slow
def test_least_squares_that_leave_the_noise_in_the_columns_are_not_sound(campaign):
    joint = fit.calibrate(campaign, estimator="flscov").joint
    assert "constraint_contradicted" in {w.code for w in joint.unsound}


def test_tails_of_the_noise_have_their_estimator(campaign):
    joint = fit.calibrate(campaign, estimator="student_t").joint
    assert not joint.unsound
    assert pulls(joint).max() < 4


def test_a_parameter_may_have_a_value_for_each_experiment(more):
    joint = fit.calibrate(more[0], shared={"lambda_y_1": "experiment"}).joint
    assert {"lambda_y_1_A", "lambda_y_1_B"} <= set(joint.parameters)
