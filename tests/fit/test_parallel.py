"""Work in threads comes out as without them, in its order, with the first error; its progress never falls."""

import subprocess
import sys
import threading

import numpy as np
import pytest
import scipy
from threadpoolctl import threadpool_info, threadpool_limits

from fit import parallel
from fit.parallel import (
    one_blas_thread,
    parallel_map,
    serial,
)


@pytest.fixture(autouse=True)
def three_processors(monkeypatch):
    monkeypatch.setattr(parallel, "processors", lambda: 3)


def test_results_come_in_the_order_of_the_items():
    turn = threading.Barrier(3, timeout=30)

    def late(n):
        turn.wait()  # three at once, or never
        return n * n

    assert parallel_map(late, range(3)) == [0, 1, 4]
    assert parallel_map(lambda n: -n, range(100)) == [-n for n in range(100)]
    assert parallel_map(late, []) == []


def test_work_within_an_item_and_within_serial_stays_in_its_thread():
    def thread(_):
        return threading.get_ident()

    for inner in parallel_map(lambda n: (thread(n), parallel_map(thread, range(5))), range(6)):
        assert inner[1] == [inner[0]] * 5
    with serial():
        assert parallel_map(thread, range(5)) == [threading.get_ident()] * 5


def test_the_first_error_is_raised():
    def fail(n):
        if n in (7, 2, 40):
            raise ValueError(str(n))
        return n

    with pytest.raises(ValueError, match=r"^2$"):
        parallel_map(fail, range(50))
    with pytest.raises(ValueError, match=r"^40$"):
        parallel_map(fail, range(50), size=float)


def blas_threads():
    scipy.linalg.qr(np.eye(3))  # its library is loaded, and NumPy's
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_one_blas_thread_within_and_as_before_afterwards():
    with threadpool_limits(limits=2, user_api="blas"):
        before = blas_threads()
        assert one_blas_thread(blas_threads)() == {1}
        assert blas_threads() == before
        with pytest.raises(ZeroDivisionError):
            one_blas_thread(lambda: 1 / 0)()
        assert blas_threads() == before


LATER = """
from fit.parallel import one_blas_thread

@one_blas_thread
def threads():
    import numpy, scipy
    scipy.linalg.qr(numpy.eye(3))
    from threadpoolctl import threadpool_info
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]

print(*threads())
"""


def test_a_library_that_is_first_imported_within_has_one_thread_too(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    output = subprocess.run([sys.executable, "-c", LATER], capture_output=True, text=True, check=True).stdout
    assert set(output.split()) == {"1"}
