"""The residual of a fit: weights that have not settled, and power that is not that of the noise runs."""

from collections.abc import Iterable, Sequence

from fit.findings import Finding
from fit.fitting import IRLSResult
from fit.results import Fit
from fit.statistics import variance
from fit.whitening import Experiment


def find(outcome: IRLSResult, experiments: Sequence[Experiment], *_: object) -> list[Finding]:
    """Warn of weights that have not settled, and of a residual that is not the noise of the noise runs."""
    warnings = []
    if not outcome.converged:
        message = "the weights have not settled entirely; estimates may still move by some 0.05 sigma"
        warnings.append(Finding("not_converged", message))
    excess, sigma = variance.chi2_ratio(outcome)
    if variance.is_misfit(excess, sigma, len(experiments)):
        message = (
            f"the residual has {excess:.3g} times the power of the noise run; the sigmas assume equal power"
        )
        warnings.append(Finding("chi2", message))
    return warnings


def is_off(fit: Fit) -> bool:
    """Return whether chi2 and its degrees of freedom have nothing to do with each other."""
    return not variance.is_plausible(fit.chi2 / max(fit.dof, 1), fit.dof)


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


def misfits(experiments: Sequence[Experiment], result: IRLSResult) -> list[Finding]:
    """Return a warning for each run whose residual has another power than its noise run."""
    warnings = []
    dofs = {e.name: run.size for e, run in zip(experiments, result.whitened_runs, strict=True)}
    for name, ratio in misfit_ratios(experiments, result).items():
        message = f"{name}: the simulated loop leaves {ratio:.3g} times the power of the noise run"
        warnings.append(
            Finding("chi2" if variance.is_plausible(ratio, dofs[name]) else "noise_mismatch", message)
        )
    return warnings


def misfit_ratios(experiments: Sequence[Experiment], result: IRLSResult) -> dict[str, float]:
    """Return chi^2 / dof of the runs of a fit for which it differs from 1."""
    n = len(experiments)
    ratios = {e.name: variance.chi2_ratio(result, k) for k, e in enumerate(experiments)}
    return {name: ratio for name, (ratio, sigma) in ratios.items() if variance.is_misfit(ratio, sigma, n)}
