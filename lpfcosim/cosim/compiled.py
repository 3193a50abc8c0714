"""The compiled part of a simulation beside the FMUs: the stepping loop, the recursion of noise, the low-pass.

The numbers have the bits of NumPy's and SciPy's.
"""

import ctypes
from functools import cache

import numpy as np
import numpy.typing as npt

from lpfcosim.modelica import engine_library

Array = npt.NDArray[np.float64]


@cache
def library() -> ctypes.CDLL:
    """Return the compiled engine."""
    engine = ctypes.CDLL(str(engine_library()))
    for name in ("run_block", "autoregress", "low_pass"):
        getattr(engine, name).restype = None
    return engine


def autoregress(x: Array, rho: float, last: float) -> None:
    """Filter noise, shape (n,), in place, with the bits of `signals.autoregress`."""
    place, n = ctypes.c_void_p(x.ctypes.data), ctypes.c_int64(x.size)
    library().autoregress(place, n, ctypes.c_double(rho), ctypes.c_double(last))


def low_pass(taps: Array, factor: int, x: Array, out: Array) -> None:
    """Filter channels with the bits of `decimation.plain`."""
    places = [ctypes.c_void_p(each.ctypes.data) for each in (taps, x, out)]
    half, apart, n = (ctypes.c_int64(number) for number in (taps.size // 2, factor, len(out)))
    library().low_pass(places[0], half, apart, *places[1:], n)
