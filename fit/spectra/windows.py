"""Windows, and a low-pass that one of them makes, as `scipy.signal` has them: that takes long to read in."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def hann(size: int) -> Array:
    """Return the periodic Hann window of a segment, shape (size,)."""
    angle = np.linspace(-np.pi, np.pi, size + 1)[:-1]
    return np.asarray(0.5 + 0.5 * np.cos(angle))


def tukey(size: int, taper: float) -> Array:
    """Return the symmetric window whose two cosine flanks take up the fraction `taper` < 1, shape (size,)."""
    if taper == 0:
        return np.ones(size)
    n = np.arange(size)
    width = int(np.floor(taper * (size - 1) / 2.0))
    w = np.ones(size)
    first, last = n[: width + 1], n[size - width - 1 :]
    w[: width + 1] = 0.5 * (1 + np.cos(np.pi * (-1 + 2.0 * first / taper / (size - 1))))
    w[size - width - 1 :] = 0.5 * (1 + np.cos(np.pi * (-2.0 / taper + 1 + 2.0 * last / taper / (size - 1))))
    return w


def low_pass(size: int, cut: float, attenuation: float) -> Array:
    """Return the taps of a low-pass by a Kaiser window: `cut` in units of the sample rate, 50 dB or more."""
    n = np.arange(size) - 0.5 * (size - 1)
    found = np.sinc(2 * cut * n) * np.kaiser(size, 0.1102 * (attenuation - 8.7))
    return np.asarray(found / found.sum(), dtype=np.float64)
