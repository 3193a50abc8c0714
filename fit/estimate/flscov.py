"""Iteratively reweighted least squares as LTPDA's ``flscov`` does it with its default settings (eq. irls).

Ten stretches of a run overlap by two thirds under a Blackman-Harris window; of their transforms every fourth
bin counts, from the fifth on. Each bin is weighted by its power in the residual of the previous iteration,
averaged over the stretches, and all stretches count as independent. It is here to be compared with: such
weights are themselves noise, which makes the estimates scatter more than their sigmas say. The commands are
delayed as in the other fits, where LTPDA linearises about zero delay.
"""

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.model import Columns
from fit.signal import Spectrum, derivatives
from fit.weighing import Block, Weights, drives, single_tone

Array = NDArray[np.float64]

STRETCHES, OVERLAP = 10, 0.661
FIRST, STRIDE = 4, 4
TOLERANCE = 1e-6  # relative change of the summed weights


def transform(terms: Columns) -> tuple[Array, Spectrum]:
    """Return frequencies [Hz], shape (B,), and the transforms of the stretches, shape (10, B, P).

    Their scale is that of `spectra.Spectra`. Missing samples have been bridged by straight lines.
    """
    N = len(terms.values)
    n = math.floor(N / (1 + (STRETCHES - 1) * (1 - OVERLAP)))
    w = np.asarray(scipy.signal.windows.blackmanharris(n, sym=False), dtype=np.float64)
    step = round(n * (1 - OVERLAP))
    starts = np.minimum(np.arange(STRETCHES) * step, N - n)
    bins = slice(FIRST, math.floor(min(derivatives.F_MAX, terms.fs / 10) * n / terms.fs) + 1, STRIDE)
    scale = math.sqrt(2 / (terms.fs * float(w @ w)))
    found = [scipy.fft.rfft(w[:, None] * terms.values[a : a + n], axis=0)[bins] * scale for a in starts]
    return np.arange(n // 2 + 1)[bins] * terms.fs / n, np.stack(found)


def block(terms: Columns, share: Array, c: Array | None) -> tuple[Block, float]:
    """Weigh a run by its own residual; without coefficients `c` of the columns to make one, all bins alike.

    Returns
    -------
    block : Block
        For `linear.minimise`.
    total : float
        The summed weights' denominators, whose change tells when to stop.
    """
    f, columns = transform(terms)
    S = np.ones(f.size) if c is None else np.mean(np.abs(columns @ c) ** 2, axis=0)
    U = (columns * np.sqrt(2 / S)[:, None]).reshape(-1, columns.shape[2])
    tone = single_tone(f, np.mean(drives(columns), axis=0) * (2 / S)[:, None])
    one = np.ones(len(U))
    return Block(terms.tau, U, Weights(one, one, one), None, tone, share), float(np.sum(S))
