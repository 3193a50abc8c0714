"""The recursion that makes noise of 1/f of white noise, by SciPy or by a faster equivalent."""

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: ``(x, rho, last)``: replaces x, shape (n,), by ``y[i] = x[i] + rho y[i-1]``, with ``last`` for ``y[-1]``.
Recursion = Callable[[Array, float, float], None]


def autoregress(x: Array, rho: float, last: float) -> None:
    """Filter by SciPy, as `Recursion` says."""
    x[:], _ = scipy.signal.lfilter([1.0], [1.0, -rho], x, zi=[rho * last])
