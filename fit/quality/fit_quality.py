"""From the end of an iteration to a `Fit`: what is determined, what is not and why, what else to doubt.

Among the doubts are faults that leave a fit running and its sigmas wrong: noise that does not match,
experiments that contradict each other.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.findings import UNDETERMINED, Amount, Finding, undetermined
from fit.fitting import CorrectedRun, IRLSResult, linear_combination, reported_estimates, stiffnesses
from fit.parameters import ALONG
from fit.quality import noise_tests
from fit.quality.plausibility import implausible_estimates
from fit.results import Fit
from fit.telemetry import Telemetry
from fit.units import campaign_unit, concise_value
from fit.whitening import Experiment

Array = NDArray[np.float64]

SIGNIFICANT = 2.0  # sigma, of a width from which a parameter is said to scatter
NEGLIGIBLE = 0.01  # least coefficient, in widths of the weak priors, that is named in a blind direction
NOTABLE = 0.5  # sigma, of a correction for the noise of regressors that is reported
EARLY = 0.05  # s, half a control step: by so much a time may be a matter of convention
CERTAIN = 5.0  # sigma


def as_fit(outcome: IRLSResult, experiments: Sequence[Experiment]) -> Fit:
    """Report the determinable parameters of the dynamics; everything else becomes warnings.

    Cross-talk (Eq. (3)) was fitted along but is not reported, see `fit.crosstalk.crosstalk_fit`.

    Parameters
    ----------
    outcome : IRLSResult
        Of the fit.
    experiments : sequence of Experiment
        What was fitted.

    Raises
    ------
    FitError
        If a sigma is no positive number.
    """
    names = {p.name: p.name for p in outcome.parameters if p.equation not in ALONG}
    undetermined = indeterminable(outcome, experiments, names)
    fit = report(
        outcome, experiments, names, [*undetermined, *doubts(outcome, experiments), *scattered(outcome)]
    )
    stiffness = stiffnesses(outcome, [e.sysid.telemetry for e in experiments])
    return replace(fit, stiffness=stiffness, solved=outcome.solved)


def report(
    outcome: IRLSResult,
    experiments: Sequence[Experiment],
    names: Mapping[str, str],
    warnings: Sequence[Finding],
) -> Fit:
    """Report those of the named parameters that are determinable.

    Parameters
    ----------
    outcome : IRLSResult
        Of the fit; chi2 and dof are its own, whatever part of its parameters is named.
    experiments : sequence of Experiment
        What was fitted.
    names : mapping of str to str
        Of the parameters, in the outcome and in the report.
    warnings : sequence of Finding
        To go with it.

    Raises
    ------
    FitError
        If a sigma is no positive number.
    """
    reported = {i: names[name] for name, i in outcome.determined.items() if name in names}
    estimates, covariance = reported_estimates(outcome, reported)
    return Fit(
        parameters=estimates,
        covariance_matrix=covariance,
        chi2=outcome.solution.chi2,
        dof=outcome.solution.dof,
        converged=outcome.converged,
        warnings=tuple(warnings),
        masked_samples=sum(run.n_masked for e in experiments for run in (e.sysid, e.noise) if run),
    )


def indeterminable(
    outcome: IRLSResult, experiments: Sequence[Experiment], reported: Mapping[str, str]
) -> list[Finding]:
    """Name every blind direction of what is reported, then what is lost without belonging to one."""
    runs = [experiment.sysid.telemetry for experiment in experiments]
    parameters = [replace(p, name=reported.get(p.name, p.name)) for p in outcome.parameters]
    warnings: list[Finding] = []
    covered: set[str] = set()
    width = np.array([p.prior_sigma for p in parameters])
    mine = np.array([p.name in reported for p in outcome.parameters])
    for direction in (*outcome.directions, *np.eye(width.size)[outcome.undetermined]):
        part = np.abs(direction) > NEGLIGIBLE
        names = tuple(parameters[i].name for i in np.flatnonzero(part & outcome.undetermined))
        if set(names) <= covered or not (part & outcome.undetermined & mine).any():
            continue
        covered |= set(names)
        natural = direction * width / width[np.argmax(np.abs(direction))]
        reason = _reason(names, runs)
        causes = tuple(
            Finding(UNDETERMINED, reason, channel=p.name, amount=Amount(p.value, p.prior_sigma, p.unit))
            for p in parameters
            if p.name in names
        )
        message = undetermined(causes, is_combination=len(names) > 1)
        pair = [int(i) for i in np.flatnonzero(part & outcome.undetermined)]
        if len(pair) == 2:
            message += _other_direction(outcome, pair, natural)
        combination = {parameters[i].name: float(natural[i]) for i in np.flatnonzero(part)}
        single = causes if len(names) == 1 else ()
        warnings.append(
            Finding(UNDETERMINED, message, parameters=names, combination=combination, causes=single)
        )
    return warnings


def _other_direction(outcome: IRLSResult, pair: Sequence[int], blind: Array) -> str:
    """Say what is known of two parameters that cannot be separated; nothing if nothing is."""
    parameter, partner = (outcome.parameters[i] for i in pair)
    factor = -float(blind[pair[0]] / blind[pair[1]])
    known = linear_combination(outcome, {parameter.name: 1.0, partner.name: factor})
    if known is None:
        return ""
    return (
        f"; only {parameter.name} {'-' if factor < 0 else '+'} {abs(factor):.4g} {partner.name} = "
        f"{concise_value(*known)} {campaign_unit(parameter.unit)} is determined"
    )


def _reason(names: Sequence[str], runs: Sequence[Telemetry]) -> str:
    """Say in plain words why a combination is blind and what would determine it."""
    if all(name.startswith("b_") for name in names):
        return "its contribution is smaller than the noise"
    if {"lambda_1", "C_1"} & set(names):
        if not any(np.any(run.channels["f_x_1"]) for run in runs):
            return "no run drives test mass 1; a run with an injection into F_x_1 is needed"
        return "test mass 1 is hardly driven; a larger injection into F_x_1 is needed"
    if any("." in name for name in names):  # of an FMU, nothing but its name is known
        if len(names) > 1:
            return "the read-outs depend only on their combination"
        return "the read-outs hardly depend on it"
    authority = {"alpha_x": "F_max", "alpha_phi": "N_max"}
    varied = {f"{alpha}_{j}": f"{key}_{j}" for alpha, key in authority.items() for j in (1, 2)}
    keys = [varied[name] for name in names if name in varied]
    constant = [key for key in keys if np.ptp([getattr(run, key) for run in runs]) == 0]
    if constant:
        verb = "is the same" if len(constant) == 1 else "are the same"
        return f"{' and '.join(constant)} {verb} in every run; a run with another value is needed"
    if keys:
        return f"the runs vary {' and '.join(keys)} too little or only together; other values are needed"
    return "the injections are too weak, too short or of too few frequencies"


def scattered(outcome: IRLSResult) -> list[Finding]:
    """Say by how much parameters differ between the experiments."""
    chosen = ", as the data require" if outcome.data_driven else ""
    warnings = []
    determined = outcome.determined
    for name, (width, sigma) in outcome.scatter.items():
        if name not in determined:
            continue
        verb = "scatters" if width > SIGNIFICANT * sigma else "may scatter"
        text = (
            f"{name} {verb} between the experiments by {concise_value(width, sigma)} beyond noise{chosen}; "
            "its sigma is that of the mean over such experiments"
        )
        warnings.append(Finding("random_effects", text, parameters=(name,)))
    return warnings


def doubts(outcome: IRLSResult, experiments: Sequence[Experiment]) -> list[Finding]:
    """Warn of assumptions behind the sigmas that may be violated."""
    warnings = without_noise_run(e.name for e in experiments if e.noise is None)
    if not outcome.determined and not outcome.exact.all():
        warnings.append(Finding("no_estimate", "the data determine no parameter"))
    for experiment in experiments:
        noise = experiment.noise or experiment.sysid
        lacking = ", ".join(sorted({*experiment.sysid.channels.means} - {*noise.channels.means}))
        if lacking:
            message = (
                f"{experiment.name}: its noise run has no usable mean of {lacking}, whose force along x is "
                "subtracted from the run only: the noise that it leaves in the weights widens the sigmas"
            )
            warnings.append(Finding("noise_run_channel_missing", message))
    warnings += implausible_estimates(outcome, experiments[0].sysid.spacecraft)
    return [*warnings, *of_residual(outcome, len(experiments)), *notable_corrections(outcome)]


def notable_corrections(outcome: IRLSResult) -> list[Finding]:
    """Name the parameters that the correction moved by more than `NOTABLE` of their sigmas."""
    theta, shift = outcome.solution.theta, np.zeros(outcome.solution.theta.size)
    for block in (block for run in outcome.whitened_runs for block in run.blocks):
        if isinstance(block, CorrectedRun):
            scores = block.noise_products @ block.coefficients(theta)
            shift += block.gradient(theta).T @ scores
    pulls = outcome.solution.covariance @ shift / outcome.solution.sigma
    names = tuple(p.name for p, x in zip(outcome.parameters, pulls, strict=True) if abs(x) > NOTABLE)
    if not names:
        return []
    message = (
        f"the noise of the read-outs would bias {', '.join(names)} by up to {np.abs(pulls).max():.2g} sigma; "
        "the fit subtracts that bias, which it estimates from the noise run"
    )
    return [Finding("attenuation", message, parameters=names)]


def without_noise_run(names: Iterable[str]) -> list[Finding]:
    """Warn of experiments without a noise run."""
    words = (
        "without a noise run the weights come from the run's own residual; chi2 "
        "per degree of freedom is 1 by construction, and effects missing from the model count as noise"
    )
    return [Finding("no_noise_run", f"{name}: {words}", name) for name in names]


def of_residual(outcome: IRLSResult, n_experiments: int) -> list[Finding]:
    """Warn of weights that have not settled, and of a residual that is not the noise of the noise runs."""
    warnings = []
    if not outcome.converged:
        message = "the weights have not settled entirely; estimates may still move by some 0.05 sigma"
        warnings.append(Finding("not_converged", message))
    excess, sigma = noise_tests.chi2_ratio(outcome)
    if noise_tests.is_misfit(excess, sigma, n_experiments):
        message = (
            f"the residual has {excess:.3g} times the power of the noise run; the sigmas assume equal power"
        )
        warnings.append(Finding("chi2", message))
    return warnings


def lead_time(outcome: IRLSResult, lambda_name: str, C_name: str) -> str | None:
    """Return by how many seconds a command acts before it is given, in print; None if it does not.

    Its gain and the product of gain and delay have these names; both must be determined.
    """
    positions = outcome.determined
    if not {lambda_name, C_name} <= positions.keys():
        return None
    gain, C = (float(outcome.solution.theta[positions[name]]) for name in (lambda_name, C_name))
    sigma = float(outcome.solution.sigma[positions[C_name]])
    early = -C / gain if gain > 0 else 0.0
    return concise_value(early, sigma / gain) if early > max(EARLY, CERTAIN * sigma / gain) else None


def acausal(outcome: IRLSResult, commands: Sequence[str]) -> list[Finding]:
    """Doubt a joint fit in which commands act before they are given: some time is wrong in every run."""
    early_commands: dict[str, str] = {}
    for name in outcome.determined:
        gain, of_command = name.replace("C_", "lambda_", 1), name.removeprefix("C_")
        if name.startswith("C_") and (lead := lead_time(outcome, gain, name)):
            command = next(channel for channel in commands if channel.endswith(of_command))
            early_commands[name] = (
                f"{command} acts {lead} s before it is commanded: it is late in the files of every run, or "
                "the read-outs are early"
            )
    if not early_commands:
        return []
    message = f"{'; '.join(early_commands.values())}; C is not that of the actuators"
    return [Finding("acausal", message, parameters=tuple(early_commands))]


def suspects(single_fits: Mapping[str, IRLSResult | FitError]) -> dict[str, str]:
    """Return words on the experiments that could keep a joint fit from settling, by name."""
    reasons: dict[str, str] = {}
    for name, single in single_fits.items():
        if isinstance(single, FitError):
            reasons[name] = f"{name} alone does not fit either"
            continue
        ratio = single.solution.chi2 / single.solution.dof
        if ratio > 1 and not noise_tests.is_plausible(ratio, single.solution.dof):
            reasons[name] = f"{name} alone leaves {ratio:.3g} times the power of the noise"
    return reasons


def is_off(fit: Fit) -> bool:
    """Return whether chi2 and its degrees of freedom have nothing to do with each other."""
    return not noise_tests.is_plausible(fit.chi2 / max(fit.dof, 1), fit.dof)


def of_experiment(name: str, fit: Fit) -> list[Finding]:
    """Doubt the noise run of an experiment that was fitted on its own."""
    if not is_off(fit):
        return []
    excess = fit.chi2 / fit.dof
    cause = (
        "its noise run does not match it, or the equation lacks something"
        if excess > 1
        else ("its noise run is louder than the run itself and does not match it")
    )
    message = (
        f"{name}: the residual has {excess:.3g} times the power of the noise run: {cause}; the "
        "uncertainties are not valid"
    )
    return [Finding("noise_mismatch", message, name)]


def of_joint(joint: Fit, fits: Iterable[tuple[str, Fit]]) -> list[Finding]:
    """Doubt the joint fit for the sake of its experiments, by name, or for what they say together."""
    mismatched = [name for name, fit in fits if any(w.code == "noise_mismatch" for w in fit.warnings)]
    if mismatched:
        names = ", ".join(mismatched)
        message = f"the noise of {names} is not that of the noise run, on which weights and sigmas depend"
        return [Finding("noise_mismatch", message)]
    if is_off(joint):
        message = (
            f"each experiment fits on its own, but the joint fit leaves {joint.chi2 / joint.dof:.3g} times "
            "the power of the noise: the parameters that they share differ between them; the uncertainties "
            "are not valid"
        )
        return [Finding("contradiction", message)]
    return []
