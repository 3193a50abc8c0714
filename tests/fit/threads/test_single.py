"""The linear algebra has one thread while a function runs, and what it had before afterwards."""

import subprocess
import sys

import numpy as np
import pytest
import scipy
from threadpoolctl import threadpool_info, threadpool_limits

from fit.threads import one_thread


def threads():
    scipy.linalg.qr(np.eye(3))  # its library is there, and NumPy's
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_one_thread_within_and_as_before_afterwards():
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        assert one_thread(threads)() == {1}
        assert threads() == before


def test_an_error_leaves_the_threads_as_they_were():
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        with pytest.raises(ZeroDivisionError):
            one_thread(lambda: 1 / 0)()
        assert threads() == before


LATER = """
from fit.threads import one_thread

@one_thread
def threads():
    import numpy, scipy
    scipy.linalg.qr(numpy.eye(3))
    from threadpoolctl import threadpool_info
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]

print(*threads())
"""


def test_a_library_that_is_first_asked_for_within_has_one_thread_too(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    told = subprocess.run([sys.executable, "-c", LATER], capture_output=True, text=True, check=True).stdout
    assert set(told.split()) == {"1"}
