"""Cross-talk that drifts between the experiments of an alignment epoch.

The fit takes b_1 to b_6 of an epoch for constant. In flight the coefficients of rotation drifted, about
1 um/rad in 100 d (arXiv 2407.05852): by more than the sigma of one experiment. Where the experiments tell
that b_1 or b_2 differ by more than chance, the sigma is that of the mean of experiments that differ so.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.false_alarms import p_limit
from fit.fitting import normal
from fit.fitting.irls import IRLSResult
from fit.fitting.random_effects import heterogeneity
from fit.results import Fit
from fit.warnings import FitWarning
from fit.whitening import Experiment

Array = NDArray[np.float64]

DRIFTING = ("b_1", "b_2")


@dataclass(frozen=True)
class Drift:
    """By how much a coefficient differs between experiments.

    Attributes
    ----------
    width : float
        Standard deviation between the experiments, in the unit of the coefficient.
    variance : float
        What that adds to the variance of the mean that was fitted.
    """

    width: float
    variance: float


def cross_talk_drift(
    outcome: IRLSResult, experiments: Sequence[Experiment], names: Mapping[str, str], epoch: int
) -> dict[str, Drift]:
    """Measure the drift of the coefficients of an epoch; those that show none are not in what is returned.

    Parameters
    ----------
    outcome : IRLSResult
        Of the joint fit.
    experiments : sequence of Experiment
        What was fitted.
    names : mapping of str to str
        The coefficients as fitted, and their names in reports.
    epoch : int
        Theirs.
    """
    theta, whitened_runs, prior = outcome.solution.theta, outcome.whitened_runs, outcome.conditional_prior
    positions = {
        coefficient: i
        for i, p in enumerate(outcome.parameters)
        if (coefficient := names.get(p.name, "")) in DRIFTING
    }
    of_epoch = [m for m, e in enumerate(experiments) if e.sysid.telemetry.alignment_epoch == epoch]
    # every experiment of the epoch that has a coefficient gets one of its own in the place of that they share
    runs_by_name = {
        name: [m for m in of_epoch if whitened_runs[m].parameter_map[:, i].any()]
        for name, i in positions.items()
        if not outcome.undetermined[i]
    }
    runs_by_name = {name: runs for name, runs in runs_by_name.items() if len(runs) > 1}
    if not runs_by_name:
        return {}
    retained = np.delete(np.arange(theta.size), [positions[name] for name in runs_by_name])
    places = [(m, name) for name, runs in runs_by_name.items() for m in runs]
    size = retained.size + len(places)
    H, b = np.zeros((size, size)), np.zeros(size)
    H[: retained.size, : retained.size] = prior.rows[:, retained].T @ prior.rows[:, retained]
    b[: retained.size] = -prior.rows[:, retained].T @ (prior.rows @ (theta - prior.centre))
    equations = normal.normal_equations_by_run(
        whitened_runs, theta, normal.variance_factors(whitened_runs, theta)
    )
    for m, (block, run) in enumerate(zip(whitened_runs, equations, strict=True)):
        to_run = np.zeros((len(block.parameter_map), size))
        to_run[:, : retained.size] = block.parameter_map[:, retained]
        for column, (member, name) in enumerate(places, start=retained.size):
            if member == m:
                to_run[:, column] = block.parameter_map[:, positions[name]]
        H += to_run.T @ run.H @ to_run
        b += to_run.T @ run.b
    covariance = normal.inverse(H)
    change, drifts = covariance @ b, {}
    for name in runs_by_name:
        rows = [retained.size + k for k, (_, member) in enumerate(places) if member == name]
        drift = estimate_drift(change[rows], covariance[np.ix_(rows, rows)])
        if drift:
            drifts[name] = drift
    return drifts


def estimate_drift(values: Array, covariance: Array) -> Drift | None:
    """Return by how much values differ beyond their covariance, shape (M, M); None where chance may do it."""
    result = heterogeneity(values, covariance)
    if result.p > p_limit("consistency", len(DRIFTING)):
        return None
    weights = np.linalg.solve(covariance, np.ones(values.size))
    weights /= weights.sum()
    return Drift(result.width, result.width**2 * float(weights @ weights))


def inflate_sigma(fit: Fit, drifts: Mapping[str, Drift]) -> Fit:
    """Return the cross-talk of an epoch with sigmas that hold the drift, and say so."""
    names = list(fit.parameters)
    reported = {name: drift for name, drift in drifts.items() if name in names}
    if not reported:
        return fit
    variances = np.array([reported[name].variance if name in reported else 0.0 for name in names])
    covariance = fit.covariance + np.diag(variances)
    parameters = {
        name: replace(e, sigma=float(np.sqrt(e.sigma**2 + of_drift)))
        for (name, e), of_drift in zip(fit.parameters.items(), variances.tolist(), strict=True)
    }
    widths = ", ".join(
        f"{name} ({drift.width:.2g} {fit.parameters[name].unit})" for name, drift in reported.items()
    )
    message = (
        f"these differ between the experiments of the epoch, beyond noise by: {widths}; their sigmas are "
        "those of the mean over such experiments"
    )
    warning = FitWarning("cross_talk_drift", tuple(reported), message)
    return replace(fit, parameters=parameters, covariance=covariance, warnings=(*fit.warnings, warning))
