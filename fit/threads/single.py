"""One thread for the linear algebra."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")


def one_thread(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Return a function that calls another while the linear algebra has one thread.

    Matrices here are tall and narrow: its threads wait for each other more than they compute. Where other
    work shares the processors they wait for that too, for four times as long as the fit takes.
    """

    @wraps(function)
    def limited(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        import scipy.linalg  # noqa: F401  SciPy's library: only what is loaded can be limited
        from threadpoolctl import threadpool_limits  # looks for libraries when it is called, not before

        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
