"""Which runs are left out, on voices drawn at random: the fewest, groups as one, none if nobody can tell."""

from dataclasses import replace

import numpy as np
import pytest

from fit.consistency.agreement import ALONE, agree, leaning, odd_ones, scattering
from fit.consistency.consistency import Regression, Voice

K, P = 7, 6  # coefficients that a run determines, parameters that runs share
TOLD = np.array([2e4, 2e4, 1e3, 1e3, 1.0, 1.0, 1.0])  # 1 / sigma of the parameters of a run


def campaign(seed, runs, wrong=(), by=50.0):
    """Return the voices of some runs; in those that are wrong the coefficient of lambda_2 is another."""
    rng = np.random.default_rng(seed)
    voices = []
    for i in range(runs):
        answer, share = rng.standard_normal((K, K + 1)), rng.standard_normal((K, P))
        z = rng.standard_normal(K) - (by * answer[:, 2] if i in wrong else 0.0)
        gradient, nothing = np.eye(K + 1, K, k=-1) * TOLD, (np.zeros((0, K, K)), np.zeros((0, 0)))
        voices.append(Voice(f"run {i}", z, answer, gradient, share, np.zeros(K), (0.0, 0.0), *nothing))
    return Regression(tuple(voices), np.ones(P), np.zeros((0, P)), np.zeros(0))


@pytest.mark.parametrize("wrong", [(3,), (1, 6), (0, 2, 8)])
def test_the_fewest_are_left_out(wrong):
    found = odd_ones(campaign(1, 9, wrong))
    assert found.left_out == wrong
    assert found.fewest == len(wrong)


def test_a_group_counts_as_one():
    # without the second group nothing is left but what is wrong alike
    wrong = (0, 1, 2)
    voices = campaign(2, 7, wrong)
    group = {frozenset(f"run {i}" for i in wrong)}
    assert odd_ones(voices, group).left_out == wrong
    # and none of it goes for the sake of the others in it
    assert odd_ones(campaign(2, 7, (1,)), group).left_out == (1,)


def alike(voices, wrong, by):
    """Return the voices with the stiffness of test mass 1 in some runs off by so many of its sigmas."""
    own = (replace(v, z=v.z - by * v.answer[:, 6]) if i in wrong else v for i, v in enumerate(voices.voices))
    return replace(voices, voices=tuple(own))


def test_what_no_single_run_tells_a_group_does():
    wrong, groups = (1, 4, 6), {frozenset({"run 1", "run 4", "run 6"}), frozenset({"run 0", "run 1"})}
    voices = alike(campaign(20, 9), wrong, 1.7)
    assert agree(voices)
    assert not agree(voices, groups)
    found = odd_ones(voices, groups)
    assert (found.left_out, found.fewest, found.alike) == (wrong, 3, True)


def test_some_of_a_group_do_not_go_without_the_others():
    # two of them tell that they are wrong, one tells nothing
    voices = alike(campaign(8, 9), (0, 1), 6.0)
    deaf = replace(voices.voices[2], answer=voices.voices[2].answer * (np.arange(K + 1) != 6))
    voices = replace(voices, voices=(*voices.voices[:2], deaf, *voices.voices[3:]))
    assert odd_ones(voices).left_out == (0, 1)
    assert odd_ones(voices, {frozenset({"run 0", "run 1", "run 2"})}).left_out == (0, 1, 2)


def test_a_group_does_not_go_for_what_one_of_it_alone_tells():
    # the other two do not hear what is wrong with the first
    voices = alike(campaign(8, 9), (0,), 6.0)
    deaf = [replace(v, answer=v.answer * (np.arange(K + 1) != 6)) for v in voices.voices[1:3]]
    voices = replace(voices, voices=(voices.voices[0], *deaf, *voices.voices[3:]))
    assert odd_ones(voices, {frozenset({"run 0", "run 1", "run 2"})}).left_out == (0,)


def test_half_of_the_runs_wrong_alike_cost_no_single_one():
    groups = {frozenset({"run 0", "run 1", "run 2"}), frozenset({"run 3", "run 4", "run 5"})}
    voices = alike(campaign(9, 6), (0, 1, 2), 1.5)
    assert odd_ones(voices).left_out == (2,)  # though it is no more wrong than the others
    assert odd_ones(voices, groups) is None


def test_half_of_the_runs_are_too_many():
    assert odd_ones(campaign(3, 6, (0, 1, 2))) is None
    assert odd_ones(campaign(4, 2, (0,))) is None


def test_what_scatters_leaves_no_run_out():
    rng = np.random.default_rng(5)
    voices = campaign(5, 9)
    voices = replace(
        voices,
        voices=tuple(replace(v, z=v.z - 60 * rng.standard_normal() * v.answer[:, 2]) for v in voices.voices),
    )
    assert not agree(voices)
    assert odd_ones(voices) is None


def scattered(seed, runs, by):
    """Return voices of which gains and delays of both test masses scatter by so many of their sigmas."""
    rng, voices = np.random.default_rng(seed), campaign(seed, runs)
    own = [v.z - v.answer[:, 1:5] @ (by * rng.standard_normal(4)) for v in voices.voices]
    return replace(voices, voices=tuple(replace(v, z=z) for v, z in zip(voices.voices, own, strict=True)))


# without these runs the others agree: the first barely (p = 9e-4), the second by chance (p = 0.2)
@pytest.mark.parametrize(("seed", "by", "out"), [(12, 0.7, (0, 1)), (18, 1.0, (0, 2))])
def test_runs_that_scatter_a_little_are_not_odd(seed, by, out):
    voices = scattered(seed, 6, by)
    assert not agree(voices)
    assert agree(voices.without(out))
    assert odd_ones(voices) is None
    assert scattering(voices)[0].left.p > 0.01


@pytest.mark.stat  # 1 of 300 campaigns: three of 30 by chance in 2e-4
def test_noise_is_no_scatter():
    assert sum(bool(scattering(campaign(seed, 5), ALONE)) for seed in range(100, 130)) < 3


def test_gains_and_delays_may_scatter_together():
    likeliest, *others = scattering(scattered(40, 6, 1.5))
    assert likeliest.parameters == ["lambda_1", "lambda_2", "C_1", "C_2"]
    assert likeliest.left.p > 0.01
    assert not others  # neither is enough


@pytest.mark.stat  # 100 campaigns, false alarms 5e-4 each: three by chance in 1e-5
def test_noise_is_no_contradiction():
    groups = {frozenset({"run 0", "run 1"}), frozenset({"run 2", "run 3"})}
    assert sum(not agree(campaign(seed, 5), groups) for seed in range(100, 200)) < 3


def test_what_one_run_tells_rests_on_it():
    voices = campaign(6, 5)
    own = tuple(
        replace(v, share=v.share * (np.arange(P) > 0)) if i else v for i, v in enumerate(voices.voices)
    )
    found = leaning(replace(voices, voices=own), np.zeros(P, dtype=bool))
    assert 0 in found[0]
    assert not any(0 in of_run for i, of_run in found.items() if i)
