"""Weighing a run by its noise run."""

from types import SimpleNamespace

import numpy as np
import pytest

from fit.whitening import Experiment, Run, fit_residual_noise, noise_model
from tests.oracles.synthetic import World, of_run, telemetry

F, SLOW = np.arange(1, 2161) / 21600, np.arange(1, 9) / 216000


def run(f, power):
    """Return the residual of a run at frequencies f; its power may depend on the model before."""
    return SimpleNamespace(terms=SimpleNamespace(f=f), power=lambda previous, _=None: power(previous))


QUICK = run(F, lambda _: np.ones((2, F.size)))


def test_slower_noise_that_was_left_alone_is_heard_again_only_when_much_louder():
    # else what it changes could take it out again, and so on without an end
    shorter = fit_residual_noise(QUICK, None)

    def weighed(times, previous):
        longer = run(SLOW, lambda _: np.stack([times * shorter.expected(SLOW), np.ones(SLOW.size)]))
        return fit_residual_noise(QUICK, previous, longer)

    def is_used(times, previous):
        return bool(weighed(times, previous).n_below)

    by_it = weighed(9.0, None)
    assert [is_used(times, shorter) for times in (0.5, 1.5, 3.0)] == [False, False, True]
    assert [is_used(times, by_it) for times in (0.5, 1.5, 3.0)] == [False, True, True]
    assert [is_used(times, None) for times in (0.5, 1.5, 3.0)] == [False, True, True]


def test_slower_noise_that_is_heard_a_second_time_stays():
    # the weights with it make it look quiet, those without it loud
    shorter = fit_residual_noise(QUICK, None)

    def of_slow(previous):
        times = 0.5 if previous and previous.n_below else 3.0
        return np.stack([times * shorter.expected(SLOW), np.ones(SLOW.size)])

    models, model = [], None
    for _ in range(6):
        models.append(model := fit_residual_noise(QUICK, model, run(SLOW, of_slow)))
    assert [bool(model.n_below) for model in models] == [False, True, True, True, True, True]


def test_a_run_is_weighed_by_the_psd_of_its_noise_run():
    # some 600 bins
    world, louder, f = World(), World(plateau=12e-15), np.geomspace(3e-3, 30e-3, 50)
    runs = telemetry(louder, kind="sysid"), telemetry(world, kind="noise")
    experiment = Experiment(*map(Run, runs))
    theta = np.array([of_run(world, "A")[name] for name in experiment.parameters])
    S = noise_model(experiment, theta, np.zeros((theta.size, theta.size)), None)(f)
    true = world.plateau**2 + (world.tail * 1e-4 / f) ** 2 + (world.oms * (2 * np.pi * f) ** 2) ** 2
    assert np.mean(S / true) == pytest.approx(1, abs=0.2)
