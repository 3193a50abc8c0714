"""Iteratively reweighted least squares as LTPDA's ``flscov`` does it with its default settings (Eq. (7)).

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

from fit.model import Columns, Equation
from fit.spectra import Spectrum, derivatives
from fit.whitening import Weights, WhitenedRun

Array = NDArray[np.float64]

SEGMENTS, OVERLAP = 10, 0.661
FIRST_BIN, STRIDE = 4, 4
TOLERANCE = 1e-6  # relative change of the summed weights


def transform(terms: Columns) -> tuple[Array, Spectrum]:
    """Return frequencies [Hz], shape (B,), and the transforms of the stretches, shape (10, B, P).

    Their scale is that of `spectra.Spectra`. Missing samples have been bridged by straight lines.
    """
    N = len(terms.values)
    n = math.floor(N / (1 + (SEGMENTS - 1) * (1 - OVERLAP)))
    w = scipy.signal.windows.blackmanharris(n, sym=False)
    starts = np.minimum(np.arange(SEGMENTS) * round(n * (1 - OVERLAP)), N - n)
    bins = slice(FIRST_BIN, math.floor(min(derivatives.F_MAX, terms.fs / 10) * n / terms.fs) + 1, STRIDE)
    scale = math.sqrt(2 / (terms.fs * float(w @ w)))
    spectra = [scipy.fft.rfft(w[:, None] * terms.values[a : a + n], axis=0)[bins] * scale for a in starts]
    return np.arange(n // 2 + 1)[bins] * terms.fs / n, np.stack(spectra)


def block(terms: Columns, equation: Equation, share: Array, c: Array | None) -> tuple[WhitenedRun, float]:
    """Weigh an equation of a run by its own residual, without coefficients `c` of its columns all bins alike.

    Returns
    -------
    block : WhitenedRun
        For the joint model.
    total : float
        The summed weights' denominators, whose change decides when to stop.
    """
    f, columns = transform(terms)
    columns = columns if equation.basis is None else columns @ equation.basis
    S = np.ones(f.size) if c is None else np.mean(np.abs(columns @ c) ** 2, axis=0)
    U = (columns * np.sqrt(2 / S)[:, None]).reshape(-1, columns.shape[2])
    one = np.ones(len(U))
    even = Weights(one, one, one)
    return WhitenedRun(terms.tau, U, even, None, share, equation=equation), float(np.sum(S))
