"""How noise is drawn and filtered: by NumPy and SciPy, or by whoever does the same in less time."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]
Fill = Callable[[Array], object]


@dataclass(frozen=True)
class Drawing:
    """What all streams of a run are drawn with.

    Attributes
    ----------
    normals : callable
        From a generator to what fills an array, shape (n,), with the next of its normal numbers.
    redden : callable
        ``(x, rho, last)``: filters an array in its place, ``y[i] = x[i] + rho y[i-1]`` with ``last`` for the
        y before the first, and returns the last.
    """

    normals: Callable[[np.random.Generator], Fill]
    redden: Callable[[Array, float, float], float]


def numpy_normals(generator: np.random.Generator) -> Fill:
    """Let the generator fill arrays by itself."""
    return lambda out: generator.standard_normal(out=out)


def scipy_redden(x: Array, rho: float, last: float) -> float:
    """Filter as `Drawing.redden` does."""
    x[:], _ = scipy.signal.lfilter([1.0], [1.0, -rho], x, zi=[rho * last])
    return float(x[-1]) if x.size else last


PLAIN = Drawing(numpy_normals, scipy_redden)
