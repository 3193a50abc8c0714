"""Masked segments: impulses that, projected out, remove all that the fitted band can hold of a segment.

The impulses are so close that what the fitted band can hold of the segment is a sum of them. The rest of the
run is unchanged, where a notch in the window would cost a minute on either side and leak what is slow and
strong into all frequencies.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fit.spectra import derivatives

Spectrum = NDArray[np.complex128]
Array = NDArray[np.float64]

PER_CYCLE = 4.0  # impulses per cycle of the highest frequency of the band
MARGIN = 2  # samples on either side of a segment and of the reach of the stencils
RANK_TOLERANCE = 1e-6  # of the largest singular value


def impulse_samples(segments: Sequence[tuple[float, float]], time: Array, fs: float) -> NDArray[np.intp]:
    """Return at which samples the masked segments [s] need an impulse.

    All are of one grid, so that overlapping segments share them.

    Parameters
    ----------
    segments : sequence of tuple of float
        Begin and end [s].
    time : ndarray, shape (N,)
        Evenly spaced instants [s].
    fs : float
        Their rate [Hz].
    """
    step = fs / (PER_CYCLE * min(derivatives.F_MAX, fs / 10))
    reach = (derivatives.HALF + MARGIN + step) / fs
    samples = np.rint(np.arange(0, time.size - 1, step)).astype(np.intp)
    inside = np.zeros(samples.size, dtype=bool)
    for begin, end in segments:
        inside |= (time[samples] >= begin - reach) & (time[samples] <= end + reach)
    return np.asarray(samples[inside])


def impulse_basis(samples: NDArray[np.intp], n: int, bins: slice) -> Spectrum:
    """Return an orthogonal basis, shape (B, K), of the transforms of impulses at some of n samples."""
    k = np.arange(bins.start, bins.stop)
    transforms = np.exp((-2j * np.pi / n) * (np.outer(k, samples) % n))
    squares, vectors = np.linalg.eigh((transforms.conj().T @ transforms).real)
    significant = squares > RANK_TOLERANCE**2 * squares.max(initial=0.0)
    return np.asfortranarray(transforms @ (vectors[:, significant] / np.sqrt(squares[significant])))
