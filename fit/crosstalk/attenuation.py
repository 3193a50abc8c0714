"""What becomes of estimates that noise in the read-outs of spacecraft motion has moved."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.crosstalk.instrumental_variables import Freed
from fit.fitting import IRLSResult
from fit.results import Estimate, Fit
from fit.warnings import FitWarning

Array = NDArray[np.float64]

NOTABLE = 0.1  # sigma, by which instruments must move an estimate to be worth their sigma


def widened(fit: Fit, shift: Mapping[str, float]) -> Fit:
    """Return a fit whose sigmas hold an expected shift.

    Parameters
    ----------
    fit : Fit
        Of couplings.
    shift : mapping of str to float
        The shift to expect of each parameter, SI; NaN where it cannot be told: that one is withheld.
    """
    names = list(fit.parameters)
    off = np.array([shift.get(name, 0.0) for name in names])
    kept = np.flatnonzero(np.isfinite(off))
    sigma = np.sqrt(np.diag(fit.covariance))
    far = np.abs(off) > sigma  # less is what sigma allows for
    covariance = (fit.covariance + np.diag(np.where(far & np.isfinite(off), off, 0.0) ** 2))[
        np.ix_(kept, kept)
    ]
    wider = np.sqrt(np.diag(covariance))
    parameters = {
        names[i]: replace(fit.parameters[names[i]], sigma=float(s)) if far[i] else fit.parameters[names[i]]
        for i, s in zip(kept.tolist(), wider, strict=True)
    }
    return replace(fit, parameters=parameters, covariance=covariance)


def moves(given: Mapping[str, Estimate], least: IRLSResult) -> dict[str, tuple[float, float]]:
    """Return by how much instruments move estimates [SI], and how many times they widen them.

    Parameters
    ----------
    given : mapping of str to Estimate
        What is given beside instruments, see `mended`.
    least : IRLSResult
        The same fit by least squares.
    """
    at = {p.name: i for i, p in enumerate(least.parameters)}
    theta, sigma = least.solution.theta, least.solution.sigma
    return {n: (e.value - float(theta[at[n]]), e.sigma / float(sigma[at[n]])) for n, e in given.items()}


def mended(joint: Fit, outcome: IRLSResult, freed: Freed, shift: Array, before: Array) -> Fit:
    """Return the joint fit with what attenuation moves as it is beside couplings that are free of noise.

    Where the thrusters move the spacecraft along x and sideways at once, o_1 answers for what attenuated
    couplings leave: least squares then finds delta_ifo and the stiffness of test mass 1 off as well. Sigmas
    are those beside the instruments, and hold what attenuated couplings leave still.

    Parameters
    ----------
    joint : Fit
        By least squares.
    outcome : IRLSResult
        Of it.
    freed : Freed
        The same with instruments.
    shift : ndarray, shape (P,)
        What is still expected of attenuation, SI; NaN where it cannot be told.
    before : ndarray, shape (P,)
        What was to be expected of it by least squares, likewise; what it hardly shifts stays as it is.
    """
    names, least, after = list(joint.parameters), outcome.solution, freed.outcome.solution
    scale, moved, parameters = np.ones(len(names)), {}, dict(joint.parameters)
    for i, p in enumerate(outcome.parameters):
        apart = (least.theta[i] - after.theta[i]) / least.sigma[i]
        left = float(np.nan_to_num(shift[i])) / least.sigma[i]
        shifted = not abs(before[i]) < NOTABLE * least.sigma[i]
        if p.name in names and shifted and max(abs(apart), abs(left)) > NOTABLE:
            wider = np.hypot(max(after.sigma[i] / least.sigma[i], 1.0), left)
            sigma = joint.parameters[p.name].sigma * float(wider)
            parameters[p.name] = replace(parameters[p.name], value=float(after.theta[i]), sigma=sigma)
            scale[names.index(p.name)], moved[p.name] = wider, float(apart)
    if not moved:
        return joint
    message = (
        "given beside couplings that are free of the noise of their read-outs, as far as there are "
        "instruments; least squares is off by so many of its sigmas: "
        + ", ".join(f"{name} ({by:+.1f})" for name, by in moved.items())
    )
    warning = FitWarning("instrumental_variables", tuple(moved), message)
    covariance = joint.covariance * np.outer(scale, scale)
    return replace(joint, parameters=parameters, covariance=covariance, warnings=(*joint.warnings, warning))
