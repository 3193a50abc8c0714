"""Transforms of long series of which the lowest bins count, in as much memory as these need.

A series of n samples is dealt out to M shorter ones, by turns. Bin k of its transform is the sum of theirs,
each turned by the time at which it begins, as long as they reach so high (Cooley and Tukey, Math. Comput. 19,
1965).
"""

from collections.abc import Iterator

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.threads import freed_by

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

_FOLDS = (5, 4, 3, 2)  # that are tried
_PLANS = 16  # lengths that SciPy keeps what it needs for, as large as a series


@freed_by
def _short_plans() -> None:
    """Have SciPy forget long series over short ones."""
    for n in range(2, 2 + _PLANS):
        scipy.fft.rfft(np.zeros(n))


def transform(x: Array, w: Array, end: int) -> Spectrum:
    """Return the bins 0 to `end`, that left out, of the transform of ``x w``, both of shape (n,)."""
    folds = _folds(w.size, end)
    found = np.zeros(end, dtype=np.complex128)
    for m, turn in enumerate(_turns(w.size, end, folds)):
        found += scipy.fft.rfft(x[m::folds] * w[m::folds])[:end] * turn
    return found


def inverse(columns: Spectrum, first: int, n: int, out: Array) -> None:
    """Fill `out`, shape (n,), with the inverse transform of bins, shape (B,), that begin at `first`."""
    end = first + columns.size
    folds = _folds(n, end)
    padded = np.zeros(n // folds // 2 + 1, dtype=np.complex128)
    for m, turn in enumerate(_turns(n, end, folds)):
        np.divide(columns, turn[first:] * folds, out=padded[first:end])
        out[m::folds] = scipy.fft.irfft(padded, n // folds)


def _folds(n: int, end: int) -> int:
    """Return into how many series to deal n samples, for their transforms to have all bins below `end`."""
    return next((m for m in _FOLDS if n % m == 0 and n // m > 2 * end), 1)


def _turns(n: int, end: int, folds: int) -> Iterator[Spectrum]:
    angle = np.arange(end) * (-2j * np.pi / n)
    return (np.exp(angle * m) for m in range(folds))
