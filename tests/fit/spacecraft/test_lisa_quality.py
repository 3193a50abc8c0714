"""What LISA inherits of the tests of the data: one pipeline judges every spacecraft."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import fit
from tests.oracles import lisa_loop

WORLD = lisa_loop.World()


@lru_cache(maxsize=4)
def experiment(name="A", seed=0):
    runs = lisa_loop.campaign(WORLD, lisa_loop.sequence(1e-6), seed=seed)
    return [replace(run, run=f"{name}-{run.kind}", experiment=name) for run in runs]


def changed(run, **factors):
    return replace(run, channels={**run.channels, **{n: x * run.channels[n] for n, x in factors.items()}})


def largest_pull(joint):
    return max(abs(e.value - WORLD.truth[name]) / e.sigma for name, e in joint.parameters.items())


def test_an_experiment_that_contradicts_the_others_is_left_out():
    driven, noise = experiment("C", 2)
    results = fit.calibrate([*experiment(), *experiment("B", 1), changed(driven, grs_y_1=1.005), noise])
    assert results.provenance.joint_runs == ["A-sysid", "B-sysid"]
    assert not results.joint.unsound
    assert largest_pull(results.joint) < 3.5


def test_a_gain_that_differs_in_one_experiment_scatters():
    driven, noise = experiment("C", 2)
    joint = fit.calibrate([*experiment(), *experiment("B", 1), changed(driven, F_y_1=1.005), noise]).joint
    assert "random_effects" in {w.code for w in joint.warnings}
    assert joint["lambda_y_1"].sigma > 1e-3
    assert largest_pull(joint) < 3.5


def test_equal_noise_under_two_names_is_refused():
    with pytest.raises(fit.InputError, match=r"the same noise as in .*cannot be two runs"):
        fit.calibrate(
            [*experiment(), *(replace(run, run=f"B-{run.kind}", experiment="B") for run in experiment())]
        )


def test_another_level_of_the_noise_run_is_marginalised():
    driven, noise = experiment()
    quiet = changed(noise, **dict.fromkeys(lisa_loop.OUTPUTS[:4] + lisa_loop.OUTPUTS[5:7], 0.7))
    joint = fit.calibrate([driven, quiet]).joint
    assert "marginalised_noise" in {w.code for w in joint.warnings}
    assert not joint.unsound
    assert largest_pull(joint) < 3.5


def test_a_glitch_is_masked():
    driven, noise = experiment()
    t = np.maximum(np.arange(driven.size) - 12000.0, 0)  # 50 pm/s that decay in 100 s
    moved = driven.channels["o_2"] + 5e-9 * (1 - np.exp(-t / 100))
    joint = fit.calibrate([replace(driven, channels={**driven.channels, "o_2": moved}), noise]).joint
    assert "glitches" in {w.code for w in joint.warnings}
    assert not joint.unsound
    assert largest_pull(joint) < 3.5


def test_least_squares_that_leave_the_noise_in_the_columns_are_not_sound():
    joint = fit.calibrate(experiment(), estimator="flscov").joint
    assert "constraint_contradicted" in {w.code for w in joint.unsound}


@pytest.mark.parametrize("estimator", ["student_t", "marginalised"])
def test_estimators_have_their_meaning(estimator):
    joint = fit.calibrate(experiment(), estimator=estimator).joint
    assert not joint.unsound
    assert largest_pull(joint) < 4


def test_a_parameter_may_have_a_value_for_each_experiment():
    runs = [*experiment(), *experiment("B", 1)]
    joint = fit.calibrate(runs, shared={"lambda_y_1": "experiment"}).joint
    assert {"lambda_y_1_A", "lambda_y_1_B"} <= set(joint.parameters)
    with pytest.raises(fit.InputError, match=r"fit\.scatter: lambda_1: no parameter of A"):
        fit.calibrate(runs, scatter=["lambda_1"])
