"""Attenuation: noise in the read-outs of spacecraft motion makes couplings too small and shifts others."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.crosstalk import instrumental_variables, readout_noise
from fit.crosstalk.fitted_run import FittedRun, fitted_runs
from fit.fitting import IRLSResult
from fit.model import dynamics
from fit.parallel import parallel_map
from fit.results import Estimate, Fit
from fit.warnings import FitWarning
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]

NEGLIGIBLE = (
    0.1  # sigma, expected shift up to which least squares is kept, and correction that is not applied
)
REPORTED = 1.0  # sigma, expected shift that is warned of
MAX_NOISE_FRACTION = 0.5  # of noise in some combination of the regressors, above which the shift is unknown


@dataclass(frozen=True)
class AttenuationCorrected:
    """A joint fit without the attenuation by noise in the read-outs of motion, as far as instruments allow.

    Attributes
    ----------
    iv : IVResult
        The fit, and which parameters have instruments.
    shift : ndarray, shape (P,)
        By how much such noise is still expected to shift it, see `expected_shift`.
    uncorrected_shift : ndarray, shape (P,)
        By how much it is expected to shift least squares.
    """

    iv: instrumental_variables.IVResult
    shift: Array
    uncorrected_shift: Array


def correct_attenuation(outcome: IRLSResult, experiments: Sequence[Experiment]) -> AttenuationCorrected:
    """Correct the joint fit for the noise of the read-outs of spacecraft motion.

    Raises
    ------
    FitError
        If a noise PSD cannot be fitted.
    """
    runs = fitted_runs(outcome, experiments)
    floors = parallel_map(readout_noise.noise_psd, [run.experiment.sysid for run in runs])
    uncorrected_shift = shift = expected_shift(outcome, runs, floors)
    in_sigma = zip(outcome.parameters, (uncorrected_shift / outcome.solution.sigma).tolist(), strict=True)
    shifts = {p.name: value for p, value in in_sigma if not abs(value) < NEGLIGIBLE}
    iv = instrumental_variables.estimate(outcome, runs, shifts)
    if iv.names:
        shift = expected_shift(iv.outcome, runs, floors, iv.names)
    return AttenuationCorrected(iv, shift, uncorrected_shift)


def expected_shift(
    outcome: IRLSResult,
    runs: Sequence[FittedRun],
    floors: Sequence[Mapping[str, float]],
    corrected: Container[str] = (),
) -> Array:
    """Return by how much noise in the read-outs of spacecraft motion is expected to shift a fit.

    Noise of PSD S_n in a regressor adds to the normal equations what stands for no signal, so that
    ``E[theta] = (1 - G) truth`` with ``G = (H + prior)^-1 H_n``; the eigenvalues of G are the share of noise
    in what the data say of a combination. S_n is measured, see `readout_noise.noise_psd`; that the spacecraft
    answers to the noise of its own sensors is left out: right above the band of the loops, where the
    cross-talk is large.

    Parameters
    ----------
    outcome : IRLSResult
        Of the fit.
    runs : sequence of FittedRun
        What was fitted.
    floors : sequence of mapping
        What `readout_noise.noise_psd` tells of their runs.
    corrected : container of str
        Parameters whose regressors count as free of noise.

    Returns
    -------
    ndarray, shape (P,)
        Expected error of the parameters, SI; NaN where the regressors hold too much noise to tell.
    """
    theta = outcome.solution.theta
    width = np.array([p.prior_sigma for p in outcome.parameters])
    prior = outcome.conditional_prior.rows
    H, H_n = prior.T @ prior, np.zeros((theta.size, theta.size))
    clean = np.array([p.name in corrected for p in outcome.parameters])
    for w, floor in zip(runs, floors, strict=True):
        terms, to_run = w.terms, w.block.parameter_map
        H += whitened_run.information([whitened_run.whiten_run(terms, w.noise, to_run)], theta)
        weight = 2 / w.S
        for mean, S_n in floor.items():
            rows = np.zeros((terms.f.size, len(to_run)))
            for i, name in enumerate(w.experiment.parameters):
                if dynamics.CROSS_TALK.get(name, ("", 0))[0] == mean and not to_run[i, clean].any():
                    rows[:, i] = (-((2 * np.pi * terms.f) ** 2)) ** (dynamics.CROSS_TALK[name][1] // 2)
            H_n += to_run.T @ (rows.T * (S_n * weight)) @ rows @ to_run
    root = np.linalg.inv(np.linalg.cholesky(width[:, None] * H * width))
    share_of_noise, V = np.linalg.eigh(root @ (width[:, None] * H_n * width) @ root.T)
    components = width[:, None] * (root.T @ V) * np.linalg.solve(V, np.linalg.solve(root.T, theta / width))
    doubtful = share_of_noise > MAX_NOISE_FRACTION
    shift = -components[:, ~doubtful] @ (share_of_noise / (1 - share_of_noise))[~doubtful]
    unknown = np.abs(components[:, doubtful]).sum(axis=1) > REPORTED * outcome.solution.sigma
    return np.where(unknown, np.nan, shift)


def inflate_sigma(fit: Fit, shift: Mapping[str, float]) -> Fit:
    """Return a fit whose sigmas include an expected shift.

    Parameters
    ----------
    fit : Fit
        Of couplings.
    shift : mapping of str to float
        The shift to expect of each parameter, SI; NaN where it is unknown: that one is left out.
    """
    names = list(fit.parameters)
    shifts = np.array([shift.get(name, 0.0) for name in names])
    known = np.flatnonzero(np.isfinite(shifts))
    sigma = np.sqrt(np.diag(fit.covariance))
    large = np.abs(shifts) > sigma  # less is what sigma allows for
    covariance = (fit.covariance + np.diag(np.where(large & np.isfinite(shifts), shifts, 0.0) ** 2))[
        np.ix_(known, known)
    ]
    inflated = np.sqrt(np.diag(covariance))
    parameters = {
        names[i]: replace(fit.parameters[names[i]], sigma=float(s)) if large[i] else fit.parameters[names[i]]
        for i, s in zip(known.tolist(), inflated, strict=True)
    }
    return replace(fit, parameters=parameters, covariance=covariance)


def iv_correction(
    corrected: Mapping[str, Estimate], least_squares: IRLSResult
) -> dict[str, tuple[float, float]]:
    """Return by how much instruments move estimates [SI], and how many times they widen them.

    Parameters
    ----------
    corrected : mapping of str to Estimate
        The estimates with instruments, see `apply_iv`.
    least_squares : IRLSResult
        The same fit by least squares.
    """
    index = {p.name: i for i, p in enumerate(least_squares.parameters)}
    theta, sigma = least_squares.solution.theta, least_squares.solution.sigma
    return {
        n: (e.value - float(theta[index[n]]), e.sigma / float(sigma[index[n]])) for n, e in corrected.items()
    }


def apply_iv(joint: Fit, outcome: IRLSResult, correction: AttenuationCorrected) -> Fit:
    """Return the joint fit with what attenuation shifts as estimated with instrumental variables.

    Where the thrusters move the spacecraft along x and sideways at once, o_1 takes up what attenuated
    couplings leave: least squares then shifts delta_ifo and the stiffness of test mass 1 as well. Sigmas are
    those with instruments, and include the shift that is still expected.

    Parameters
    ----------
    joint : Fit
        By least squares.
    outcome : IRLSResult
        Of it.
    correction : AttenuationCorrected
        The same with instruments. What attenuation hardly shifts stays as it is.
    """
    names, uncorrected = list(joint.parameters), outcome.solution
    corrected = correction.iv.outcome.solution
    scale, corrections, parameters = np.ones(len(names)), {}, dict(joint.parameters)
    for i, p in enumerate(outcome.parameters):
        change = (uncorrected.theta[i] - corrected.theta[i]) / uncorrected.sigma[i]
        remaining = float(np.nan_to_num(correction.shift[i])) / uncorrected.sigma[i]
        is_shifted = not abs(correction.uncorrected_shift[i]) < NEGLIGIBLE * uncorrected.sigma[i]
        if p.name in names and is_shifted and max(abs(change), abs(remaining)) > NEGLIGIBLE:
            inflated = np.hypot(max(corrected.sigma[i] / uncorrected.sigma[i], 1.0), remaining)
            sigma = joint.parameters[p.name].sigma * float(inflated)
            parameters[p.name] = replace(parameters[p.name], value=float(corrected.theta[i]), sigma=sigma)
            scale[names.index(p.name)], corrections[p.name] = inflated, float(change)
    if not corrections:
        return joint
    message = (
        "estimated with instrumental variables, without the noise of the read-outs of motion; least squares "
        "is off by so many of its sigmas: "
        + ", ".join(f"{name} ({shift:+.1f})" for name, shift in corrections.items())
    )
    warning = FitWarning("instrumental_variables", tuple(corrections), message)
    covariance = joint.covariance * np.outer(scale, scale)
    return replace(joint, parameters=parameters, covariance=covariance, warnings=(*joint.warnings, warning))
