"""What the residual is taken to be like, bin by bin, as weights of a least-squares fit.

With the residual power u = 2 |r|^2 / S of a bin (mean 2 where S is right), each likelihood is minus a sum of

    gaussian      u / 2                                     S known from the noise run (Eq. (14))
    student_t     (nu + 2) / 2 log(1 + u / nu)              longer tails: bursts, S not quite known
    marginalised  n log(sum of u over a band of n bins)     S known but for a factor in every band, which is
                                                            marginalised out (PRD 90, 042003)

and its maximum is where a least-squares fit with the weights below reproduces itself. Use ``gaussian`` where
the noise run gives the noise, ``marginalised`` where its level may have changed in between, ``student_t``
where the run has outliers that nothing has masked.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Likelihood = Literal["gaussian", "student_t", "marginalised"]

NU = 5.0  # degrees of freedom of the Student-t: 12 % less efficient than least squares on Gaussian noise
BAND = 24  # bins at least in a band whose level is marginalised: sigma grows by 1 / (2 BAND)
BAND_WIDTH = 0.1  # and least width of a band relative to its frequency


@dataclass(frozen=True)
class Weights:
    """Factors of every bin, each of shape (B,).

    Attributes
    ----------
    fit : ndarray
        Of the squares in the fit.
    curvature : ndarray
        Of the information, second derivatives of the likelihood in units of the Gaussian's.
    score : ndarray
        Of the covariance of the scores, in units of the Gaussian's.
    level : ndarray, optional
        Of the squares in chi^2, where the noise has levels of its own; without it, all bins count alike.

    likelihood : str
        Which it is.
    """

    fit: Array
    curvature: Array
    score: Array
    level: Array | None = None
    likelihood: Likelihood = "gaussian"


def weights(likelihood: Likelihood, f: Array, u: Array) -> Weights:
    """Return the weights at the residual power of the previous estimate.

    Parameters
    ----------
    likelihood : str
        Which.
    f, u : ndarray, shape (B,)
        Frequencies [Hz] and whitened residual power, 2 on average.
    """
    if likelihood == "student_t":
        w = (NU + 2) / (NU + u)
        score = np.full(u.size, float(np.mean(w**2 * u)) / 2)
        return Weights(w, w * NU / (NU + u), score, likelihood=likelihood)
    if likelihood == "marginalised":
        w, n = np.empty(u.size), np.empty(u.size)
        for band in frequency_bands(f):
            n[band] = band.stop - band.start
            w[band] = 2 * n[band] / np.sum(u[band])
        return Weights(w, w * (1 - 1 / n), w, w, likelihood)
    one = np.ones(u.size)
    return Weights(one, one, one)


def expected_weights(likelihood: Likelihood, f: Array) -> Weights:
    """Return the weights to expect where the noise is Gaussian and of the level known.

    Parameters
    ----------
    likelihood : str
        Which.
    f : ndarray, shape (B,)
        Frequencies [Hz].
    """
    if likelihood == "student_t":
        half, chance = np.polynomial.laguerre.laggauss(40)  # u / 2 is distributed exponentially
        w = (NU + 2) / (NU + 2 * half)
        # what a bin adds to curvature and scores is a mean over where its residual points
        factors = chance @ w, chance @ (w * NU / (NU + 2 * half)), chance @ (w**2 * half)
        fit, curvature, score = (np.full(f.size, float(factor)) for factor in factors)
        return Weights(fit, curvature, score, likelihood=likelihood)
    return weights(likelihood, f, np.full(f.size, 2.0))


def frequency_bands(f: Array) -> list[slice]:
    """Divide the bins into bands of at least BAND bins and of BAND_WIDTH relative width."""
    edges = [0]
    while edges[-1] < f.size:
        wide = int(np.searchsorted(f, f[edges[-1]] * (1 + BAND_WIDTH)))
        edges.append(max(wide, edges[-1] + BAND))
    if len(edges) > 2 and edges[-1] > f.size:
        del edges[-2]  # no band shorter than the others
    edges[-1] = f.size
    return [slice(a, b) for a, b in pairwise(edges)]
