"""Attenuation: noise in the read-outs of spacecraft motion makes couplings too small and shifts others."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.crosstalk import instrumental_variables, readout_noise
from fit.crosstalk.fitted_run import FittedRun, fitted_runs
from fit.crosstalk.noise_share import noise_share
from fit.findings import Finding
from fit.fitting import IRLSResult, prior_rows
from fit.model import dynamics
from fit.parallel import parallel_map
from fit.results import Fit
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]

NEGLIGIBLE = 0.1  # sigma, largest expected shift or correction that is neglected
REPORTED = 1.0  # sigma, expected shift from which a warning is given
MAX_NOISE_FRACTION = 0.5  # of noise in some combination of the regressors, above which the shift is unknown


@dataclass(frozen=True)
class AttenuationCorrected:
    """A joint fit without the attenuation by noise in the read-outs of motion, as far as instruments allow.

    Attributes
    ----------
    outcome : IRLSResult
        The fit, with the estimate of instrumental variables as its solution.
    names : frozenset of str
        The parameters that are estimated without attenuation.
    shift : ndarray, shape (P,)
        By how much such noise is still expected to shift it, see `expected_shift`.
    uncorrected_shift : ndarray, shape (P,)
        By how much it is expected to shift least squares.
    """

    outcome: IRLSResult
    names: frozenset[str]
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
    in_sigma = outcome.solution.in_sigma(uncorrected_shift).tolist()
    names_in_sigma = zip(outcome.parameters, in_sigma, strict=True)
    shifts = {p.name: value for p, value in names_in_sigma if not abs(value) < NEGLIGIBLE}
    corrected, names = instrumental_variables.estimate(outcome, runs, shifts)
    if names:
        shift = expected_shift(corrected, runs, floors, names)
    return AttenuationCorrected(corrected, names, shift, uncorrected_shift)


def expected_shift(
    outcome: IRLSResult,
    runs: Sequence[FittedRun],
    floors: Sequence[Mapping[str, float]],
    corrected: Container[str] = (),
) -> Array:
    """Return by how much noise in the read-outs of spacecraft motion is expected to shift a fit.

    Noise of PSD S_n in a regressor adds H_n to the normal equations, see `noise_share`. S_n is measured, see
    `readout_noise.noise_psd`. The response of the spacecraft to the noise of its own sensors is neglected:
    it is small above the band of the loops, where the cross-talk is large.

    Parameters
    ----------
    outcome : IRLSResult
        Of the fit.
    runs : sequence of FittedRun
        Its runs.
    floors : sequence of mapping
        Result of `readout_noise.noise_psd` for each.
    corrected : container of str
        Parameters whose regressors count as free of noise.

    Returns
    -------
    ndarray, shape (P,)
        Expected error of the parameters, SI; NaN where the regressors hold too much noise.
    """
    theta = outcome.solution.theta
    width = np.array([p.prior_sigma for p in outcome.parameters])
    prior = prior_rows(outcome.result.params)[0]
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
    share, directions = noise_share(H, H_n, width, outcome.free)
    directions = width[:, None] * directions
    noise = directions * (directions.T @ H_n @ theta)  # of every direction in the estimates
    doubtful = share > MAX_NOISE_FRACTION
    shift = -noise[:, ~doubtful] @ (1 / (1 - share))[~doubtful]
    components = np.abs(noise[:, doubtful] / share[doubtful]).sum(axis=1)
    unknown = components > REPORTED * outcome.solution.sigma
    return np.where(unknown, np.nan, shift)


def inflate_sigma(fit: Fit, variances: Mapping[str, float]) -> Fit:
    """Return a fit whose sigmas are larger.

    Parameters
    ----------
    fit : Fit
        Of couplings.
    variances : mapping of str to float
        What adds to the variance of each parameter that is not exact, SI; one of NaN is left out of the fit.
    """
    names = list(fit.parameters)
    added = np.array([0.0 if fit[name].is_exact else variances.get(name, 0.0) for name in names])
    known = np.flatnonzero(np.isfinite(added))
    covariance = (fit.covariance_matrix + np.diag(np.nan_to_num(added)))[np.ix_(known, known)]
    parameters = {
        names[i]: replace(fit[names[i]], sigma=float(s)) if added[i] else fit[names[i]]
        for i, s in zip(known.tolist(), np.sqrt(np.diag(covariance)), strict=True)
    }
    return replace(fit, parameters=parameters, covariance_matrix=covariance)


def iv_parameters(fit: Fit | None) -> set[str]:
    """Return the parameters of a fit that instrumental variables have moved."""
    warnings = fit.warnings if fit else ()
    return {name for w in warnings if w.code == "instrumental_variables" for name in w.parameters}


def correct_joint(joint: Fit, outcome: IRLSResult, corrected: AttenuationCorrected) -> Fit:
    """Return the joint fit with instrumental variables.

    Where the thrusters move the spacecraft along x and sideways at once, o_1 takes up what attenuated
    couplings leave: least squares then shifts delta_ifo and the stiffness of test mass 1 as well. Sigmas are
    those with instruments, and include the shift that is still expected. What attenuation hardly shifts
    stays as it is.

    Parameters
    ----------
    joint : Fit
        By least squares.
    outcome : IRLSResult
        Of it.
    corrected : AttenuationCorrected
        The same with instruments.
    """
    theta, sigma = outcome.solution.theta, outcome.solution.sigma
    solution, parameters, biases = corrected.outcome.solution, dict(joint.parameters), {}
    ratio = dict.fromkeys(joint.parameters, 1.0)
    for i, name in enumerate(p.name for p in outcome.parameters):
        if name not in joint.parameters or joint.parameters[name].is_exact:
            continue
        bias = float((theta[i] - solution.theta[i]) / sigma[i])
        remaining = float(np.nan_to_num(corrected.shift[i])) / sigma[i]
        is_shifted = not abs(corrected.uncorrected_shift[i]) < NEGLIGIBLE * sigma[i]
        if is_shifted and max(abs(bias), abs(remaining)) > NEGLIGIBLE:
            e, biases[name] = joint.parameters[name], bias
            ratio[name] = float(np.hypot(max(solution.sigma[i] / sigma[i], 1.0), remaining))
            value = e.value + float(solution.theta[i] - theta[i])
            parameters[name] = replace(e, value=value, sigma=e.sigma * ratio[name])
    if not biases:
        return joint
    message = (
        "estimated with instrumental variables, without the noise of the read-outs of motion; bias of least "
        f"squares in units of its sigma: {', '.join(f'{n} ({b:+.1f})' for n, b in biases.items())}"
    )
    return replace(
        joint,
        parameters=parameters,
        covariance_matrix=joint.covariance_matrix * np.outer(list(ratio.values()), list(ratio.values())),
        warnings=(*joint.warnings, Finding("instrumental_variables", message, parameters=tuple(biases))),
    )
