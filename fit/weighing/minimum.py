"""The minimum of chi^2, by one step where that is enough and else by lmfit."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.weighing import linear

Array = NDArray[np.float64]

NEAR = 1.0  # sigma: beyond a step that short, products of parameters move less than 1e-5


def minimise(blocks: Sequence[linear.Block], prior: linear.Prior, start: Array, width: Array) -> Array:
    """Minimise chi^2 over the blocks (eq. jointlh for Gaussian noise of known PSD).

    Parameters
    ----------
    blocks : sequence of linear.Block
        The data.
    prior : linear.Prior
        What else is known.
    start, width : ndarray, shape (P,)
        Where to begin, and the natural scale of each parameter. From close by one step reaches the minimum.

    Returns
    -------
    ndarray, shape (P,)
        The parameters, SI.

    Raises
    ------
    FitError
        If the minimiser fails.
    """
    if (reached := _step(blocks, prior, start, width)) is not None:
        return reached
    if not all(np.isfinite(block.R).all() for block in blocks):
        raise FitError("the residual or its derivatives are not finite")
    import lmfit  # slow to import

    def parameters(p: Any) -> Array:
        return np.array([p[name].value for name in p]) * width

    def residuals(p: Any) -> Array:
        theta = parameters(p)
        of_prior = prior.rows @ (theta - prior.centre)
        return np.concatenate([*(block.R @ block.coefficients(theta) for block in blocks), of_prior])

    def jacobian(p: Any) -> Array:
        theta = parameters(p)
        data = [block.R @ block.of_run(theta) @ block.share * width for block in blocks]
        return np.concatenate([*data, prior.rows * width])

    p = lmfit.Parameters()
    for i, value in enumerate(start / width):
        p.add(f"p_{i}", value=value)
    options = {"scale_covar": False, "Dfun": jacobian, "ftol": 1e-14, "xtol": 1e-12}
    try:
        found = lmfit.minimize(residuals, p, method="leastsq", **options)
    except ValueError:  # lmfit's word for residuals that are not finite
        raise FitError(
            "the minimisation failed: chi2 is not finite for parameters that were tried; expected data and "
            "responses without infinite values"
        ) from None
    if not found.success or not np.isfinite(theta := parameters(found.params)).all():
        raise FitError("the minimisation failed: no minimum of chi2 is reached from the start values")
    return theta


def _step(blocks: Sequence[linear.Block], prior: linear.Prior, start: Array, width: Array) -> Array | None:
    """Take one step of Gauss and Newton; None if it is neither short nor straight, so that more is to go."""
    left = prior.rows.T @ (prior.rows @ (start - prior.centre))
    for block in blocks:
        left += block.gradient(start).T @ (block.R.T @ (block.R @ block.coefficients(start)))
    covariance = linear.curvature_covariance(linear.information(blocks, start), prior, width)
    step = -covariance @ left
    short = np.all(step**2 < NEAR**2 * np.diag(covariance))
    return start + step if short or all(isinstance(block, linear.Straight) for block in blocks) else None
