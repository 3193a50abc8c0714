"""Cross-talk of spacecraft motion (eq. bump): its coefficients, what noisy read-outs do to them.

The coefficients b_1 to b_6 are fitted along with the dynamics. Their regressors are read-outs and carry noise
of their own, the capacitive y and z most of all. Least squares then finds what subtracts best: coefficients
smaller than the couplings, the more so the higher the frequency. There are two sets of them for that reason:

* the couplings, which are reported: b_3 to b_6 are freed of the noise by instruments, see `couplings`, where
  there is a second sensor of the same motion. Where there is none they stay attenuated, and that is said;
* those that subtract best (`subtraction`), which Delta g is corrected with.

Above some 10 mHz the test masses no longer follow the spacecraft, phi'' = -dOmega_phi, and the Euler force
has the shape of b_1 and b_2. What the joint fit finds there, where the band is widest, is the sums

    b_1 + d delta_phi,    b_2 - d delta_eta.

Where the misalignment of the same period is known from low frequencies (`inertial`), it is taken off,
with its sigma. Where it is not, the sums stay, and that is said.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.crosstalk import attenuation, instrumental_variables, readout_noise
from fit.crosstalk.instruments import Weighed
from fit.fitting import IRLSResult, drift
from fit.model import Sharing, dynamics, inertial
from fit.parallel import parallel_map
from fit.quality import indeterminable, report
from fit.results import Fit, Results
from fit.warnings import FitWarning
from fit.whitening import Experiment, noise_model, whitened_run

Array = NDArray[np.float64]

NEGLIGIBLE = 0.1  # sigma, expected shift up to which least squares is kept
NOTABLE = 1.0  # sigma, expected shift that is warned of
COEFFICIENTS = tuple(name for name in dynamics.CROSS_TALK if name.startswith("b_"))
DOUBTFUL = 0.5  # share of noise in some combination of the regressors, from which no shift is told
SEPARATED, JOINED = "euler_separated", "euler_included"
_TURNED = inertial.along(inertial.BASELINE).keys()


@dataclass(frozen=True)
class Unattenuated:
    """A joint fit freed, as far as instruments allow, of what noise in the read-outs of motion does to it.

    Attributes
    ----------
    freed : Freed
        The fit, and which parameters have instruments.
    shift : ndarray, shape (P,)
        By how much such noise is expected to shift it still, see `expected_shift`.
    before : ndarray, shape (P,)
        By how much it is expected to shift least squares.
    """

    freed: instrumental_variables.Freed
    shift: Array
    before: Array


def unattenuated(outcome: IRLSResult, experiments: Sequence[Experiment]) -> Unattenuated:
    """Free the joint fit of the noise of the read-outs of spacecraft motion.

    Raises
    ------
    FitError
        If a noise PSD cannot be fitted.
    """
    weighed = weigh(outcome, experiments)
    floors = parallel_map(readout_noise.noise, [w.experiment.sysid for w in weighed])
    before = shift = expected_shift(outcome, weighed, floors)
    told = zip(outcome.parameters, (before / outcome.solution.sigma).tolist(), strict=True)
    off = {p.name: by for p, by in told if not abs(by) < NEGLIGIBLE}
    freed = instrumental_variables.free(outcome, weighed, off)
    if freed.names:
        shift = expected_shift(freed.outcome, weighed, floors, freed.names)
    return Unattenuated(freed, shift, before)


def cross_talk(
    outcome: IRLSResult, experiments: Sequence[Experiment], sharing: Sharing, found: Unattenuated
) -> dict[str, Fit]:
    """Return the couplings of eq. bump by alignment epoch.

    Each `Fit` holds ``b_1`` to ``b_6`` as far as the channels exist and the data determine them; chi2 and dof
    are those of the joint fit. Its warnings: ``indeterminable``; ``attenuation_bias``, with the coefficients
    to expect of read-outs without noise, where no instruments free them of it; ``instrumental_variables``
    where they do; ``cross_talk_drift`` of b_1 and b_2; ``correlation`` of delta_ifo with every b_i.

    The sigma of an attenuated coefficient holds the attenuation to expect; where that cannot be told, the
    coefficient is not in the fit.

    Parameters
    ----------
    outcome : IRLSResult
        Of the joint fit.
    experiments : sequence of Experiment
        What was fitted.
    sharing : Sharing
        What they share.
    found : Unattenuated
        Of the same fit.

    Raises
    ------
    FitError
        If a sigma is no positive number.
    """
    of_epoch, delta_ifo = _names(experiments, sharing)
    freed, shift, fits = found.freed, found.shift, {}
    for epoch, names in of_epoch.items():
        told = report(
            freed.outcome,
            experiments,
            names,
            [
                *indeterminable(outcome, experiments, names),
                *_attenuated(freed.outcome, shift, names, delta_ifo[epoch]),
                *_freed(outcome, freed, names),
                _correlation(outcome, names, delta_ifo[epoch]),
            ],
        )
        off = {own: shift[i] for i, p in enumerate(outcome.parameters) if (own := names.get(p.name, ""))}
        drifts = drift.measured(outcome, experiments, names, epoch)
        fits[str(epoch)] = drift.held(attenuation.widened(told, off), drifts)
    return fits


def subtraction(
    outcome: IRLSResult, experiments: Sequence[Experiment], sharing: Sharing
) -> dict[str, dict[str, float]]:
    """Return the coefficients of eq. bump by alignment epoch that subtract best: those of least squares."""
    found = [p.name for p in outcome.parameters]
    values = dict(zip(found, outcome.solution.theta.tolist(), strict=True))
    lost = dict(zip(found, outcome.lost, strict=True))
    return {
        str(epoch): {own: values[name] for name, own in names.items() if not lost[name]}
        for epoch, names in _names(experiments, sharing)[0].items()
    }


def subtracting(results: Results, epoch: str) -> dict[str, float]:
    """Return the coefficients that subtract best from runs of an epoch, the Euler force in them included."""
    fit = results.cross_talk.get(epoch)
    if fit is None:
        return {}
    best = (results.provenance.subtraction or {}).get(epoch)
    if best is not None:
        return {name: best[name] for name in COEFFICIENTS if name in best}
    return sums(fit.values, *_euler_of(results, epoch)) if is_separated(fit) else fit.values


def beside_euler(results: Results, epoch: str) -> dict[str, float]:
    """Return those of `subtracting` without the Euler force, where that has been told apart."""
    best, fit = subtracting(results, epoch), results.cross_talk.get(epoch)
    if fit is None or not is_separated(fit):
        return best
    euler = sums(dict.fromkeys(best, 0.0), *_euler_of(results, epoch))
    return {name: value - euler[name] for name, value in best.items()}


def _euler_of(results: Results, epoch: str) -> tuple[Mapping[str, float], float]:
    """Return the misalignment that the runs of an epoch have, empty if it is not known, and d [m]."""
    fit = results.inertial.get((results.provenance.cross_talk_periods or {}).get(epoch, ""))
    return fit.values if fit else {}, inertial.separation(results.provenance.frame)


def _names(
    experiments: Sequence[Experiment], sharing: Sharing
) -> tuple[dict[int, dict[str, str]], dict[int, str]]:
    """Return, by epoch, the coefficients as fitted with their names in reports, and the name of delta_ifo."""
    of_epoch: dict[int, dict[str, str]] = {}
    delta_ifo: dict[int, str] = {}
    for experiment in experiments:
        run = experiment.sysid.telemetry
        delta_ifo[run.alignment_epoch] = sharing.name("delta_ifo", run)
        for name in (n for n in experiment.parameters if n in COEFFICIENTS):
            of_epoch.setdefault(run.alignment_epoch, {})[sharing.name(name, run)] = name
    return dict(sorted(of_epoch.items())), delta_ifo


def weigh(outcome: IRLSResult, experiments: Sequence[Experiment]) -> list[Weighed]:
    """Return the sysid runs as the last iteration left them."""
    theta, covariance = outcome.solution.theta, outcome.solution.covariance
    found = []
    for experiment, block in zip(experiments, outcome.blocks, strict=True):
        of_run, share = block.share @ theta, block.share
        noise = noise_model(experiment, of_run, share @ covariance @ share.T, None)
        terms = experiment.sysid.spectra(dynamics.delays(of_run))
        found.append(Weighed(experiment, terms, noise, block))
    return found


def _attenuated(
    outcome: IRLSResult, shift: Array, names: Mapping[str, str], delta_ifo: str
) -> list[FitWarning]:
    """Name the coefficients that noise in their regressors is expected to shift notably."""
    sigma = outcome.solution.sigma
    told = {}
    for i, p in enumerate(outcome.parameters):
        if p.name in names and not outcome.lost[i] and not abs(shift[i]) < NOTABLE * sigma[i]:
            value = float(outcome.solution.theta[i])
            free = f"{value:.4g} instead of {value - shift[i]:.4g} {p.unit}".removesuffix(" 1")
            told[names[p.name]] = (
                f"{free} expected" if np.isfinite(shift[i]) else "by how much cannot be told"
            )
    if not told:
        return []
    row = [p.name for p in outcome.parameters].index(delta_ifo)
    message = (
        "the noise of the read-outs of spacecraft motion attenuates "
        + ", ".join(f"{name} ({what})" for name, what in told.items())
        + "; these coefficients subtract best but are no unbiased couplings: their sigmas hold the shift to "
        "expect, and where that cannot be told none is given"
    )
    if np.isfinite(shift[row]):
        message += f"; {delta_ifo} moves by {shift[row] / sigma[row]:+.2f} sigma"
    return [FitWarning("attenuation_bias", tuple(told), message)]


def _freed(
    outcome: IRLSResult, freed: instrumental_variables.Freed, names: Mapping[str, str]
) -> list[FitWarning]:
    """Say which coefficients instruments tell, and what that costs."""
    cost = freed.outcome.solution.sigma / outcome.solution.sigma
    of = {
        names[p.name]: float(cost[i])
        for i, p in enumerate(outcome.parameters)
        if p.name in names and p.name in freed.names and not outcome.lost[i]
    }
    if not of:
        return []
    told = ", ".join(f"{name} ({factor:.2g})" for name, factor in of.items())
    message = (
        "the two inertial sensors, each the instrument for the other, free these of the noise of the "
        f"read-outs, at so many times the sigma of least squares: {told}; the motion is subtracted with the "
        "coefficients of least squares, which subtract better"
    )
    return [FitWarning("instrumental_variables", tuple(of), message)]


def _correlation(outcome: IRLSResult, names: Mapping[str, str], delta_ifo: str) -> FitWarning:
    """Report how the coefficients correlate with the leakage of x_1 in the same epoch."""
    all_names = [p.name for p in outcome.parameters]
    sigma = outcome.solution.sigma
    row = all_names.index(delta_ifo)
    correlation = outcome.solution.covariance[row] / (sigma[row] * sigma)
    found = {own: float(correlation[all_names.index(name)]) for name, own in names.items()}
    told = ", ".join(f"{value:+.2f} ({own})" for own, value in found.items())
    return FitWarning("correlation", (delta_ifo, *found), f"correlation of {delta_ifo} with b_i: {told}")


def expected_shift(
    outcome: IRLSResult,
    weighed: Sequence[Weighed],
    floors: Sequence[Mapping[str, float]],
    freed: Container[str] = (),
) -> Array:
    """Return by how much noise in the read-outs of spacecraft motion is expected to shift a fit.

    Noise of PSD S_n in a regressor adds to the normal equations what stands for no signal, so that
    ``E[theta] = (1 - G) truth`` with ``G = (H + prior)^-1 H_n``; the eigenvalues of G are the share of noise
    in what the data say of a combination. S_n is measured, see `read_outs.noise`; that the spacecraft answers
    to the noise of its own sensors is left out: right above the band of the loops, where the cross-talk is
    large.

    Parameters
    ----------
    outcome : IRLSResult
        Of the fit.
    weighed : sequence of Weighed
        What was fitted.
    floors : sequence of mapping
        What `read_outs.noise` tells of their runs.
    freed : container of str
        Parameters whose regressors count as free of noise.

    Returns
    -------
    ndarray, shape (P,)
        Expected error of the parameters, SI; NaN where the regressors hold too much noise to tell.
    """
    theta = outcome.solution.theta
    width = np.array([p.prior_sigma for p in outcome.parameters])
    known = outcome.held.rows
    H, H_n = known.T @ known, np.zeros((theta.size, theta.size))
    clean = np.array([p.name in freed for p in outcome.parameters])
    for w, floor in zip(weighed, floors, strict=True):
        terms, to_run = w.terms, w.block.share
        H += whitened_run.information([whitened_run.block(terms, w.noise, to_run)], theta)
        weight = 2 / w.noise.expected(terms.f)
        for mean, S_n in floor.items():
            rows = np.zeros((terms.f.size, len(to_run)))
            for i, name in enumerate(w.experiment.parameters):
                if dynamics.CROSS_TALK.get(name, ("", 0))[0] == mean and not to_run[i, clean].any():
                    rows[:, i] = (-((2 * np.pi * terms.f) ** 2)) ** (dynamics.CROSS_TALK[name][1] // 2)
            H_n += to_run.T @ (rows.T * (S_n * weight)) @ rows @ to_run
    root = np.linalg.inv(np.linalg.cholesky(width[:, None] * H * width))
    share_of_noise, V = np.linalg.eigh(root @ (width[:, None] * H_n * width) @ root.T)
    parts = width[:, None] * (root.T @ V) * np.linalg.solve(V, np.linalg.solve(root.T, theta / width))
    doubtful = share_of_noise > DOUBTFUL
    shift = -parts[:, ~doubtful] @ (share_of_noise / (1 - share_of_noise))[~doubtful]
    unknown = np.abs(parts[:, doubtful]).sum(axis=1) > NOTABLE * outcome.solution.sigma
    return np.where(unknown, np.nan, shift)


def is_separated(cross_talk: Fit) -> bool:
    """Tell whether the Euler force has been taken off."""
    return any(warning.code == SEPARATED for warning in cross_talk.warnings)


def is_joined(cross_talk: Fit) -> bool:
    """Tell whether b_1 and b_2 hold the Euler force."""
    return any(warning.code == JOINED for warning in cross_talk.warnings)


def sums(values: Mapping[str, float], deltas: Mapping[str, float], d: float) -> dict[str, float]:
    """Put back what `separate` took off: the coefficients that correct Delta g_x of runs of that period."""
    parts = {
        name: factor * deltas[delta] for name, (delta, factor) in inertial.along(d).items() if delta in deltas
    }
    return {name: value + parts.get(name, 0.0) for name, value in values.items()}


def joined(cross_talk: Fit) -> Fit:
    """Say that b_1 and b_2 hold the Euler force of the runs they were fitted to."""
    names = tuple(name for name in _TURNED if name in cross_talk.parameters)
    message = (
        "b_1 and b_2 include d delta_phi and -d delta_eta, the Euler force above 10 mHz: without an inertial "
        "fit of the same period these cannot be told apart"
    )
    return replace(cross_talk, warnings=(*cross_talk.warnings, FitWarning(JOINED, names, message)))


def separate(cross_talk: Fit, misaligned: Fit, period: str, d: float) -> Fit:
    """Take the Euler force off b_1 and b_2.

    Parameters
    ----------
    cross_talk : Fit
        Of one alignment epoch, Euler force included.
    misaligned : Fit
        Of the period in which all its runs lie.
    period : str
        Its name.
    d : float
        x_2 - x_1 [m] in the frame of both.
    """
    order, deltas = list(cross_talk.parameters), list(misaligned.parameters)
    parts = {name: part for name, part in inertial.along(d).items() if name in order and part[0] in deltas}
    # b = (b as fitted) - J delta
    J = np.zeros((len(order), len(deltas)))
    for name, (delta, factor) in parts.items():
        J[order.index(name), deltas.index(delta)] = factor
    shift = J @ list(misaligned.values.values())
    covariance = cross_talk.covariance + J @ misaligned.covariance @ J.T
    sigma = np.sqrt(np.diag(covariance))
    parameters = {
        name: replace(estimate, value=estimate.value - float(shift[i]), sigma=float(sigma[i]))
        for i, (name, estimate) in enumerate(cross_talk.parameters.items())
    }
    message = (
        f"the Euler force of period {period}, which above 10 mHz has the shape of b_1 and b_2, has been "
        "taken off them; their sigmas are those of d delta_phi and d delta_eta, which cancel in Delta g"
    )
    kept = [warning for warning in cross_talk.warnings if warning.code != JOINED]
    warnings = (*kept, FitWarning(SEPARATED, tuple(parts), message))
    return replace(cross_talk, parameters=parameters, covariance=covariance, warnings=warnings)
