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


def measured(
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
    theta, blocks, held = outcome.solution.theta, outcome.blocks, outcome.held
    at = {own: i for i, p in enumerate(outcome.parameters) if (own := names.get(p.name, "")) in DRIFTING}
    of_epoch = [m for m, e in enumerate(experiments) if e.sysid.telemetry.alignment_epoch == epoch]
    # every experiment of the epoch that has a coefficient gets one of its own in the place of that they share
    each = {
        name: [m for m in of_epoch if blocks[m].share[:, i].any()]
        for name, i in at.items()
        if not outcome.lost[i]
    }
    each = {name: runs for name, runs in each.items() if len(runs) > 1}
    if not each:
        return {}
    kept = np.delete(np.arange(theta.size), [at[name] for name in each])
    places = [(m, name) for name, runs in each.items() for m in runs]
    size = kept.size + len(places)
    H, b = np.zeros((size, size)), np.zeros(size)
    H[: kept.size, : kept.size] = held.rows[:, kept].T @ held.rows[:, kept]
    b[: kept.size] = -held.rows[:, kept].T @ (held.rows @ (theta - held.centre))
    said = normal.of_runs(blocks, theta, normal.inflations(blocks, theta))
    for m, (block, run) in enumerate(zip(blocks, said, strict=True)):
        to_run = np.zeros((len(block.share), size))
        to_run[:, : kept.size] = block.share[:, kept]
        for column, (of, name) in enumerate(places, start=kept.size):
            if of == m:
                to_run[:, column] = block.share[:, at[name]]
        H += to_run.T @ run.H @ to_run
        b += to_run.T @ run.b
    covariance = normal.inverse(H)
    change, found = covariance @ b, {}
    for name in each:
        rows = [kept.size + k for k, (_, of) in enumerate(places) if of == name]
        drift = between(change[rows], covariance[np.ix_(rows, rows)])
        if drift:
            found[name] = drift
    return found


def between(values: Array, covariance: Array) -> Drift | None:
    """Return by how much values differ beyond their covariance, shape (M, M); None where chance may do it."""
    found = heterogeneity(values, covariance)
    if found.p > p_limit("consistency", len(DRIFTING)):
        return None
    weights = np.linalg.solve(covariance, np.ones(values.size))
    weights /= weights.sum()
    return Drift(found.width, found.width**2 * float(weights @ weights))


def held(fit: Fit, drifts: Mapping[str, Drift]) -> Fit:
    """Return the cross-talk of an epoch with sigmas that hold the drift, and say so."""
    names = list(fit.parameters)
    told = {name: drift for name, drift in drifts.items() if name in names}
    if not told:
        return fit
    more = np.array([told[name].variance if name in told else 0.0 for name in names])
    covariance = fit.covariance + np.diag(more)
    parameters = {
        name: replace(e, sigma=float(np.sqrt(e.sigma**2 + of_drift)))
        for (name, e), of_drift in zip(fit.parameters.items(), more.tolist(), strict=True)
    }
    by = ", ".join(f"{name} ({drift.width:.2g} {fit.parameters[name].unit})" for name, drift in told.items())
    message = (
        f"these differ between the experiments of the epoch, by so much beyond noise: {by}; their sigmas are "
        "those of the mean over such experiments"
    )
    warning = FitWarning("cross_talk_drift", tuple(told), message)
    return replace(fit, parameters=parameters, covariance=covariance, warnings=(*fit.warnings, warning))
