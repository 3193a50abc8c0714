"""How noise is drawn and filtered: by NumPy and SciPy, or by whoever does the same in less time."""

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: ``(out, size, rho, last)``: fills an array, shape (n,), from the next normal numbers x of a generator,
#: ``out[i] = size x[i] + rho out[i-1]`` with ``last`` for what was before the first; returns the last.
Fill = Callable[[Array, float, float, float], float]

#: What all streams of a run are drawn with: from a generator to what fills arrays.
Drawing = Callable[[np.random.Generator], Fill]


def plain(generator: np.random.Generator) -> Fill:
    """Let the generator fill arrays by itself."""

    def fill(out: Array, size: float, rho: float, last: float) -> float:
        generator.standard_normal(out=out)
        out *= size
        if rho:
            out[:], _ = scipy.signal.lfilter([1.0], [1.0, -rho], out, zi=[rho * last])
        return float(out[-1]) if out.size else last

    return fill
