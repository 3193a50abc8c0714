"""A first fit of one run, before any estimate: free of what experiments share."""

import numpy as np
from numpy.typing import NDArray

from fit.signal import Spectrum
from fit.weighing import linear


def least(U: Spectrum) -> NDArray[np.float64]:
    """Return the coefficients of whitened columns, shape (P,), the first of them 1, that leave the least."""
    rows = linear.stacked(U)
    norms = np.linalg.norm(rows, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    c = np.linalg.lstsq(rows[:, 1:] / scale[1:], -rows[:, 0])[0] / scale[1:]
    return np.array([1.0, *c])
