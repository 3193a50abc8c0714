"""Results are kept until memory is given back."""

import weakref

import numpy as np

from fit.threads import give_back, kept


def test_results_are_kept_until_memory_is_given_back():
    @kept(1)
    def zeros(size):
        return np.zeros(size)

    found = weakref.ref(zeros(3))
    assert zeros(3) is found()
    give_back()
    assert found() is None
    assert zeros(3).size == 3


def test_no_more_results_are_kept_than_asked_for():
    @kept(2)
    def zeros(size):
        return np.zeros(size)

    found = [weakref.ref(zeros(size)) for size in (1, 2, 3)]
    assert [of() is None for of in found] == [True, False, False]
