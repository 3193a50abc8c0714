"""Patches: stretches of a run that are to tell nothing, whatever is in them.

A patch is made of impulses so close that what the fitted band can hold of the stretch is a sum of them.
Projected out, they leave the rest of the run as it is. A notch in the window would cost a minute on either
side, and spread what is slow and strong over all frequencies.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fit.spectra import derivatives

Spectrum = NDArray[np.complex128]
Array = NDArray[np.float64]

PER_CYCLE = 4.0  # impulses, of the highest frequency of the band
BESIDE = 2  # samples on either side of a patch and of what stencils make of it
ALIKE = 1e-6  # of the strongest sum of impulses: what the band holds less of depends on the others


def impulses(stretches: Sequence[tuple[float, float]], time: Array, fs: float) -> NDArray[np.intp]:
    """Return at which of the evenly spaced instants `time` [s], shape (N,), patches need an impulse.

    All are of one grid, so that patches side by side share them.
    """
    step = fs / (PER_CYCLE * min(derivatives.F_MAX, fs / 10))
    reach = (derivatives.HALF + BESIDE) / fs + step / fs
    at = np.rint(np.arange(0, time.size - 1, step)).astype(np.intp)
    inside = np.zeros(at.size, dtype=bool)
    for begin, end in stretches:
        inside |= (time[at] >= begin - reach) & (time[at] <= end + reach)
    return np.asarray(at[inside])


def columns(at: NDArray[np.intp], n: int, bins: slice) -> Spectrum:
    """Return independent sums of the transforms of impulses at some of n samples, one in each column."""
    k = np.arange(bins.start, bins.stop)
    found = np.exp((-2j * np.pi / n) * (np.outer(k, at) % n))
    squares, vectors = np.linalg.eigh((found.conj().T @ found).real)
    kept = squares > ALIKE**2 * squares.max(initial=0.0)
    return np.asfortranarray(found @ (vectors[:, kept] / np.sqrt(squares[kept])))
