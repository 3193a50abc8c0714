"""Cross-talk of spacecraft motion (Eq. (3)): its coefficients, what noisy read-outs do to them.

The coefficients b_1 to b_6 are fitted along with the dynamics. Their regressors are read-outs and carry noise
of their own, the capacitive y and z most of all. Least squares then finds what subtracts best: coefficients
smaller than the couplings, the more so the higher the frequency. There are two sets of them for that reason:

* the couplings, which are reported: b_3 to b_6 by `instrumental_variables`, unattenuated, where there is a
  second sensor of the same motion. Where there is none they stay attenuated, and a warning reports that;
* those that subtract best (`subtraction`), which Delta g is corrected with.

Above some 10 mHz the test masses no longer follow the spacecraft, phi'' = -dOmega_phi, and the Euler force
has the shape of b_1 and b_2. What the joint fit finds there, where the band is widest, is the sums

    b_1 + d delta_phi,    b_2 - d delta_eta.

Where the misalignment of the same period is known from low frequencies (`inertial`), it is taken off,
with its sigma. Where it is not, the sums stay, and that is said.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.checks import determined
from fit.crosstalk import attenuation
from fit.crosstalk.attenuation import AttenuationCorrected
from fit.false_alarms import p_limit
from fit.findings import Finding
from fit.fitting import Heterogeneity, IRLSResult, heterogeneity, report
from fit.model import Sharing, dynamics, inertial_forces, rotation
from fit.results import Fit, Results, correlation_matrix
from fit.whitening import Experiment

Array = NDArray[np.float64]

COEFFICIENTS = tuple(name for name in dynamics.CROSS_TALK if name.startswith("b_"))
DRIFTING = ("b_1", "b_2")
SEPARATED, INCLUDED = "euler_separated", "euler_included"
_TURNED = inertial_forces.along(inertial_forces.BASELINE).keys()


def cross_talk(
    outcome: IRLSResult,
    experiments: Sequence[Experiment],
    sharing: Sharing,
    correction: AttenuationCorrected,
    joint_findings: Sequence[Finding] = (),
) -> dict[str, Fit]:
    """Return the couplings of Eq. (3) by alignment epoch.

    Each `Fit` holds ``b_1`` to ``b_6`` as far as the channels exist and the data determine them; chi2 and dof
    are those of the joint fit, as is the lmfit model, in which they are attenuated.

    Its warnings: ``indeterminable``; ``attenuation_bias``, with the coefficients
    to expect of read-outs without noise, where no instruments free them of it; ``instrumental_variables``
    where they do; ``cross_talk_drift`` of b_1 and b_2; ``correlation`` of delta_ifo with every b_i;
    ``euler_included`` where runs turn; what invalidates the sigmas of the joint fit.

    The sigma of an attenuated coefficient includes the expected attenuation; where that is unknown, the
    coefficient is not in the fit.

    Parameters
    ----------
    outcome : IRLSResult
        Of the joint fit.
    experiments : sequence of Experiment
        What was fitted.
    sharing : Sharing
        What they share.
    correction : AttenuationCorrected
        Of the same fit.
    joint_findings : sequence of Finding
        What is found of the joint fit as it is reported.

    Raises
    ------
    FitError
        If a sigma is no positive number.
    """
    turns = any(rotation.sources(e.sysid.telemetry) for e in experiments)
    of_epoch, delta_ifo = _names(experiments, sharing)
    shift, fits = correction.shift, {}
    for epoch, names in of_epoch.items():
        findings = [
            *determined.find(outcome, experiments, names),
            *_attenuated(correction.outcome, shift, names, delta_ifo[epoch]),
            *_corrected(outcome, correction, names),
            _correlation(outcome, names, delta_ifo[epoch]),
        ]
        fit = report(correction.outcome, experiments, names, findings)
        shifts = {names[p.name]: shift[i] for i, p in enumerate(outcome.parameters) if p.name in names}
        large = {n: shifts[n] for n, e in fit.parameters.items() if not abs(shifts[n]) <= e.sigma}
        fit = attenuation.inflate_sigma(fit, {name: value**2 for name, value in large.items()})
        fit = replace(_with_drift(fit, _drifts(outcome, names)), solved=outcome.solved)
        of_joint = [f for f in joint_findings if f.kind.unsound or _is_constraint(f, names)]
        fits[str(epoch)] = (with_euler_warning(fit) if turns else fit).add(of_joint)
    return fits


def _is_constraint(finding: Finding, names: Mapping[str, str]) -> bool:
    return finding.code in ("constrained", "at_bound") and any(n in names for n in finding.parameters)


def _drifts(outcome: IRLSResult, names: Mapping[str, str]) -> dict[str, Heterogeneity]:
    """Return by how much b_1 and b_2 of an epoch differ between its experiments, where by more than chance.

    The joint fit takes them for constant. In flight they drifted by about 1 um/rad in 100 d (arXiv
    2407.05852): by more than the sigma of one experiment.
    """
    drifts: dict[str, Heterogeneity] = {}
    for i, p in enumerate(outcome.parameters):
        if names.get(p.name) in DRIFTING and not outcome.undetermined[i] and outcome.model and outcome.result:
            drift = heterogeneity(outcome.model, outcome.result.params, i)
            if drift and drift.p < p_limit(len(DRIFTING)):
                drifts[names[p.name]] = drift
    return drifts


def _with_drift(fit: Fit, drifts: Mapping[str, Heterogeneity]) -> Fit:
    """Return the cross-talk of an epoch with sigmas that are those of the mean of experiments that differ."""
    reported = {name: drift for name, drift in drifts.items() if name in fit and not fit[name].is_exact}
    if not reported:
        return fit
    widths = ", ".join(f"{name} ({drift.width:.2g} {fit[name].unit})" for name, drift in reported.items())
    message = (
        f"these differ between the experiments of the epoch by more than noise: {widths}; their sigmas are "
        "those of the mean over such experiments"
    )
    finding = Finding("cross_talk_drift", message, parameters=tuple(reported))
    fit = attenuation.inflate_sigma(fit, {name: drift.variance for name, drift in reported.items()})
    return replace(fit, warnings=(*fit.warnings, finding))


def subtraction(
    outcome: IRLSResult, experiments: Sequence[Experiment], sharing: Sharing
) -> dict[str, dict[str, float]]:
    """Return the coefficients of Eq. (3) by alignment epoch that subtract best: those of least squares."""
    fitted = [p.name for p in outcome.parameters]
    values = dict(zip(fitted, outcome.solution.theta.tolist(), strict=True))
    undetermined = dict(zip(fitted, outcome.undetermined, strict=True))
    return {
        str(epoch): {b: values[name] for name, b in names.items() if not undetermined[name]}
        for epoch, names in _names(experiments, sharing)[0].items()
    }


def subtraction_coefficients(results: Results, epoch: str) -> dict[str, float]:
    """Return the coefficients that subtract best from runs of an epoch, the Euler force in them included."""
    fit = results.cross_talk.get(epoch)
    if fit is None:
        return {}
    stored = (results.provenance.subtraction or {}).get(epoch)
    if stored is not None:
        return {name: stored[name] for name in COEFFICIENTS if name in stored}
    return add_euler_force(fit.values, *_euler_of(results, epoch)) if is_separated(fit) else fit.values


def without_euler(results: Results, epoch: str) -> dict[str, float]:
    """Return those of `subtraction_coefficients` without the Euler force, where that is separated."""
    coefficients, fit = subtraction_coefficients(results, epoch), results.cross_talk.get(epoch)
    if fit is None or not is_separated(fit):
        return coefficients
    euler = add_euler_force(dict.fromkeys(coefficients, 0.0), *_euler_of(results, epoch))
    return {name: value - euler[name] for name, value in coefficients.items()}


def _euler_of(results: Results, epoch: str) -> tuple[Mapping[str, float], float]:
    """Return the misalignment that the runs of an epoch have, empty if it is not known, and d [m]."""
    fit = results.inertial.get((results.provenance.cross_talk_periods or {}).get(epoch, ""))
    return fit.values if fit else {}, inertial_forces.separation(results.provenance.frame)


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


def _attenuated(outcome: IRLSResult, shift: Array, names: Mapping[str, str], delta_ifo: str) -> list[Finding]:
    """Name the coefficients that noise in their regressors is expected to shift notably."""
    sigma = outcome.solution.sigma
    biased = {}
    for i, p in enumerate(outcome.parameters):
        is_small = abs(shift[i]) < attenuation.REPORTED * sigma[i]
        if p.name in names and not (outcome.undetermined[i] or outcome.exact[i] or is_small):
            value = float(outcome.solution.theta[i])
            free = f"{value:.4g} instead of {value - shift[i]:.4g} {p.unit}".removesuffix(" 1")
            biased[names[p.name]] = f"{free} expected" if np.isfinite(shift[i]) else "by an unknown amount"
    if not biased:
        return []
    row = [p.name for p in outcome.parameters].index(delta_ifo)
    message = (
        "the noise of the read-outs of spacecraft motion attenuates "
        + ", ".join(f"{name} ({bias})" for name, bias in biased.items())
        + "; these coefficients subtract the motion best, but are biased as couplings: their sigmas include "
        "the expected bias, or are not given where it is unknown"
    )
    if np.isfinite(shift[row]) and not outcome.exact[row]:
        message += f"; {delta_ifo} moves by {shift[row] / sigma[row]:+.2f} sigma"
    return [Finding("attenuation_bias", message, parameters=tuple(biased))]


def _corrected(
    outcome: IRLSResult, correction: AttenuationCorrected, names: Mapping[str, str]
) -> list[Finding]:
    """Report which coefficients instrumental variables estimate, and at what cost in sigma."""
    cost = outcome.solution.in_sigma(correction.outcome.solution.sigma)
    cost_of = {
        names[p.name]: float(cost[i])
        for i, p in enumerate(outcome.parameters)
        if p.name in names and p.name in correction.names
        if not (outcome.undetermined[i] or outcome.exact[i])
    }
    if not cost_of:
        return []
    ratios = ", ".join(f"{name} ({factor:.2g})" for name, factor in cost_of.items())
    message = (
        "estimated with each inertial sensor as instrumental variable for the other, which removes the bias "
        f"by read-out noise; sigma relative to least squares: {ratios}; motion is subtracted with the "
        "coefficients of least squares, which subtract better"
    )
    return [Finding("instrumental_variables", message, parameters=tuple(cost_of))]


def _correlation(outcome: IRLSResult, names: Mapping[str, str], delta_ifo: str) -> Finding:
    """Report how the coefficients correlate with the leakage of x_1 in the same epoch."""
    all_names = [p.name for p in outcome.parameters]
    correlation = correlation_matrix(outcome.solution.covariance)[all_names.index(delta_ifo)]
    with_couplings = {b: float(correlation[all_names.index(name)]) for name, b in names.items()}
    values = ", ".join(f"{value:+.2f} ({b})" for b, value in with_couplings.items())
    return Finding(
        "correlation",
        f"correlation of {delta_ifo} with b_i: {values}",
        parameters=(delta_ifo, *with_couplings),
    )


def is_separated(cross_talk: Fit) -> bool:
    """Return whether the Euler force has been subtracted."""
    return any(warning.code == SEPARATED for warning in cross_talk.warnings)


def includes_euler(cross_talk: Fit) -> bool:
    """Return whether b_1 and b_2 include the Euler force."""
    return any(warning.code == INCLUDED for warning in cross_talk.warnings)


def add_euler_force(values: Mapping[str, float], deltas: Mapping[str, float], d: float) -> dict[str, float]:
    """Undo `subtract_euler_force`: return the coefficients that correct Delta g_x of runs of that period."""
    euler = {
        name: factor * deltas[delta]
        for name, (delta, factor) in inertial_forces.along(d).items()
        if delta in deltas
    }
    return {name: value + euler.get(name, 0.0) for name, value in values.items()}


def with_euler_warning(cross_talk: Fit) -> Fit:
    """Warn that b_1 and b_2 include the Euler force of the runs they were fitted to."""
    names = tuple(name for name in _TURNED if name in cross_talk.parameters)
    message = (
        "b_1 and b_2 include d delta_phi and -d delta_eta, the Euler force above 10 mHz: without an inertial "
        "fit of the same period these cannot be separated"
    )
    return replace(cross_talk, warnings=(*cross_talk.warnings, Finding(INCLUDED, message, parameters=names)))


def subtract_euler_force(cross_talk: Fit, misaligned: Fit, period: str, d: float) -> Fit:
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
    fit, names = _shift_by_euler_force(cross_talk, misaligned, d, -1)
    message = (
        f"the Euler force of period {period}, which above 10 mHz has the shape of b_1 and b_2, has been "
        "subtracted from them; their sigmas are those of d delta_phi and d delta_eta, which cancel in Delta g"
    )
    kept_warnings = [warning for warning in cross_talk.warnings if warning.code != INCLUDED]
    return replace(fit, warnings=(*kept_warnings, Finding(SEPARATED, message, parameters=names)))


def restore_euler_force(cross_talk: Fit, misaligned: Fit, d: float) -> Fit:
    """Undo `subtract_euler_force` of the same misalignments, before those of another fit are taken off."""
    fit, _ = _shift_by_euler_force(cross_talk, misaligned, d, +1)
    warnings = tuple(warning for warning in fit.warnings if warning.code != SEPARATED)
    return with_euler_warning(replace(fit, warnings=warnings))


def _shift_by_euler_force(
    cross_talk: Fit, misaligned: Fit, d: float, sign: int
) -> tuple[Fit, tuple[str, ...]]:
    """Return the cross-talk with the Euler force added (sign 1) or taken off (-1), and the b_i changed."""
    order, deltas = list(cross_talk.parameters), list(misaligned.parameters)
    euler = {
        name: part for name, part in inertial_forces.along(d).items() if name in order and part[0] in deltas
    }
    J = np.zeros((len(order), len(deltas)))
    for name, (delta, factor) in euler.items():
        J[order.index(name), deltas.index(delta)] = factor
    # b_i with the Euler force = b_i + J delta, and b_i without it has the covariance of both
    shift = sign * (J @ list(misaligned.values.values()))
    covariance = cross_talk.covariance_matrix - sign * (J @ misaligned.covariance_matrix @ J.T)
    parameters = dict(cross_talk.parameters)
    for name in euler:  # of the shifted value, the truth is another
        estimate, i = parameters[name], order.index(name)
        value, sigma = estimate.value + float(shift[i]), float(np.sqrt(covariance[i, i]))
        parameters[name] = replace(estimate, value=value, sigma=sigma, truth=None, pull=None)
    return replace(cross_talk, parameters=parameters, covariance_matrix=covariance), tuple(euler)
