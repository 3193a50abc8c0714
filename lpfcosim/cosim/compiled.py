"""What is compiled of the simulation beside the FMUs: the stepping loop, drawing noise, and the low-pass.

The numbers have the bits of NumPy's and SciPy's, in a quarter of the time or less.
"""

import ctypes
from functools import cache

import numpy as np
import numpy.typing as npt

from lpfcosim.modelica import engine_library
from lpfcosim.signals import Fill, plain

Array = npt.NDArray[np.float64]

_TRIED = 10_000  # numbers, some hundred of which are not well inside a layer of the ziggurat
_WORD = 2**64 - 1


@cache
def library() -> ctypes.CDLL:
    """Return the compiled engine."""
    found = ctypes.CDLL(str(engine_library()))
    for name in ("run_block", "learn", "low_pass"):
        getattr(found, name).restype = None
    found.draw.restype = ctypes.c_double
    return found


def drawing(generator: np.random.Generator) -> Fill:
    """Return what fills arrays from the next normal numbers of a generator, as `signals.Fill` says.

    The generator itself stays as it is. Where NumPy does not let us, or would draw others, NumPy draws them.
    """
    bits = generator.bit_generator
    normal = _normal() if type(bits) is np.random.PCG64 else None
    return plain(generator) if normal is None else _Drawn(bits, normal)


def low_pass(taps: Array, factor: int, x: Array, out: Array) -> None:
    """Filter channels with the bits of `decimation.plain`."""
    places = [ctypes.c_void_p(each.ctypes.data) for each in (taps, x, out)]
    half, apart, n = (ctypes.c_int64(number) for number in (taps.size // 2, factor, len(out)))
    library().low_pass(places[0], half, apart, *places[1:], n)


class _Drawn:
    """A copy of a generator that goes on by itself."""

    def __init__(self, bits: np.random.BitGenerator, normal: ctypes.c_void_p) -> None:
        self._normal, known = normal, bits.state["state"]
        wide = known["state"], known["inc"]
        self._pcg = (ctypes.c_uint64 * 4)(*(word for w in wide for word in (w >> 64, w & _WORD)))

    def __call__(self, out: Array, size: float, rho: float, last: float) -> float:
        place, n = ctypes.c_void_p(out.ctypes.data), ctypes.c_int64(out.size)
        how = (ctypes.c_double(value) for value in (size, rho, last))
        return float(library().draw(self._pcg, self._normal, place, n, *how))


@cache
def _normal() -> ctypes.c_void_p | None:
    """Return NumPy's C function for one number, if it can be had and its numbers are ours."""
    try:
        function = ctypes.CDLL(np.random._generator.__file__).random_standard_normal
    except (OSError, AttributeError):  # where it is not exported
        return None
    normal = ctypes.cast(function, ctypes.c_void_p)
    library().learn(normal)
    wanted, ours = np.random.default_rng(1).standard_normal(_TRIED), np.empty(_TRIED)
    _Drawn(np.random.PCG64(1), normal)(ours, 1.0, 0.0, 0.0)
    return normal if np.array_equal(ours, wanted) else None
