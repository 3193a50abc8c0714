"""The probability of a difference of chi^2, for confidence intervals of lmfit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import scipy

from fit.errors import InputError, shown

if TYPE_CHECKING:
    from lmfit.minimizer import MinimizerResult


def delta_chi2(best: MinimizerResult, new: MinimizerResult) -> float:
    """Return the probability of a smaller difference of chisqr, for `lmfit.conf_interval`.

    lmfit's default, an F test, is for sigmas that are known up to a factor. Those of a calibration are
    known: the difference that one fixed parameter makes is distributed as chi^2 with one degree of freedom.

    Parameters
    ----------
    best, new : MinimizerResult
        The best fit, and one with a parameter fixed.

    Raises
    ------
    InputError
        If one of them is no result of lmfit.
    """
    from lmfit.minimizer import MinimizerResult  # slow to import

    for result in (best, new):
        if not isinstance(result, MinimizerResult):
            raise InputError(f"delta_chi2: {shown(result)}, expected an lmfit MinimizerResult")
    return float(scipy.special.chdtr(max(new.nfree - best.nfree, 1), max(new.chisqr - best.chisqr, 0.0)))
