"""Parameters that scatter from run to run: restricted maximum likelihood of the widths.

Deviations of one kind, one for each run, are drawn from a Gaussian of unknown width w about zero. They enter
data z of unit noise by columns Z, what is common to all runs being projected out of both. Integrated over the
deviations (Patterson and Thompson 1971; Harville 1977),

    log L(w) = -1/2 log det(1 + w^2 Z Z') - 1/2 z' (1 + w^2 Z Z')^-1 z .
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

LOG_WIDTHS = np.arange(np.log(1e-7), np.log(10.0), 0.25)  # that the likelihood is first evaluated at


@dataclass(frozen=True)
class WidthEstimate:
    """The widths of one or more kinds of deviations by restricted maximum likelihood.

    Attributes
    ----------
    widths : tuple of float
        Of each kind, in the unit of its columns; 0 where no scatter is more likely than any.
    log_likelihood : float
        Logarithm of the likelihood ratio to no scatter at all.
    explained : float
        By how much chi^2 falls.
    """

    widths: tuple[float, ...]
    log_likelihood: float
    explained: float

    @property
    def p(self) -> float:
        """Probability of as large a ratio without scatter: half a chi^2 of as many degrees of freedom."""
        return float(scipy.special.chdtrc(len(self.widths), 2 * max(self.log_likelihood, 0.0))) / 2


def estimate_widths(z: Array, kinds: Sequence[Array]) -> WidthEstimate:
    """Maximise the restricted likelihood of the widths of deviations.

    Parameters
    ----------
    z : ndarray, shape (N,)
        Data of unit noise, all other parameters projected out.
    kinds : sequence of ndarray, shape (N, D)
        Columns of the deviations of each kind, all other parameters projected out.
    """

    def at_ratios(logs: Sequence[float]) -> tuple[float, float, float]:
        """Return log width of the first kind, log L and explained chi^2 at fixed ratios to it."""
        axes, sizes, _ = np.linalg.svd(
            np.hstack([Z * np.exp(x) for Z, x in zip(kinds, (0.0, *logs), strict=True)]), full_matrices=False
        )
        power = (axes.T @ z) ** 2

        def explained(log_width: float) -> tuple[float, float]:
            squares = sizes**2 * np.exp(2 * log_width)
            chi2 = float(np.sum(power * squares / (1 + squares)))
            return chi2, (chi2 - float(np.sum(np.log1p(squares)))) / 2

        start = max(LOG_WIDTHS, key=lambda x: explained(x)[1])
        bounds = (start - 0.25, start + 0.25)
        optimum = scipy.optimize.minimize_scalar(
            lambda x: -explained(x)[1], bounds=bounds, method="bounded"
        ).x
        return float(optimum), explained(optimum)[1], explained(optimum)[0]

    ratios: tuple[float, ...] = ()
    if len(kinds) > 1:
        start = [np.log(estimate_widths(z, [Z]).widths[0] or 1e-7) for Z in kinds]

        def cost(logs: Any) -> float:
            return -at_ratios(np.ravel(logs).tolist())[1]

        initial = np.array(start[1:]) - start[0]
        ratio_fit = scipy.optimize.minimize(cost, initial, method="Nelder-Mead", tol=0.02)
        ratios = tuple(ratio_fit.x.tolist())
    log_width, log_likelihood, chi2 = at_ratios(ratios)
    if log_likelihood <= 0:
        return WidthEstimate((0.0,) * len(kinds), 0.0, 0.0)
    widths = (float(np.exp(log_width + x)) for x in (0.0, *ratios))
    return WidthEstimate(tuple(widths), log_likelihood, chi2)


@dataclass(frozen=True)
class Heterogeneity:
    """By how much estimates of one quantity differ beyond their errors.

    Attributes
    ----------
    width : float
        Standard deviation among the true values, by restricted maximum likelihood.
    chi2, dof : float and int
        Cochran's Q, the chi^2 about the weighted mean, and its degrees of freedom.
    """

    width: float
    chi2: float
    dof: int

    @property
    def p(self) -> float:
        """Probability that errors alone exceed chi2."""
        return float(scipy.special.chdtrc(self.dof, self.chi2))


def heterogeneity(values: Array, covariance: Array) -> Heterogeneity:
    """Return by how much values, shape (M,), differ beyond their covariance, shape (M, M)."""
    size = float(max(np.ptp(values), np.sqrt(np.diag(covariance)).max()))  # the unit of the width
    whitening = np.linalg.inv(np.linalg.cholesky(covariance / size**2))
    mean = whitening.sum(axis=1)
    projection = np.eye(values.size) - np.outer(mean, mean) / (mean @ mean)
    z = projection @ whitening @ (values / size)
    width = estimate_widths(z, [projection @ whitening]).widths[0] * size
    return Heterogeneity(width, float(z @ z), values.size - 1)
