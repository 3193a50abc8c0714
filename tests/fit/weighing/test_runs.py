"""Weighing a run by its noise run."""

from types import SimpleNamespace

import numpy as np

from fit.weighing import smooth_noise


def test_slower_noise_that_was_left_alone_is_heard_again_only_when_much_louder():
    # else what it changes could take it out again, and so on without an end
    f, slow = np.arange(1, 2161) / 21600, np.arange(1, 9) / 216000

    def run(f, power):
        told = np.stack([power, np.ones(f.size)])
        return SimpleNamespace(terms=SimpleNamespace(f=f), power=lambda _, first=None: told[:, :first])

    without = smooth_noise(run(f, np.ones(f.size)), None)

    def weighed(times, previous):
        longer = run(slow, times * without.expected(slow))
        return smooth_noise(run(f, np.ones(f.size)), previous, longer)

    def heard(times, previous):
        return bool(weighed(times, previous).below)

    by_it = weighed(9.0, None)
    assert [heard(times, without) for times in (0.5, 1.5, 3.0)] == [False, False, True]
    assert [heard(times, by_it) for times in (0.5, 1.5, 3.0)] == [False, True, True]
    assert [heard(times, None) for times in (0.5, 1.5, 3.0)] == [False, True, True]
