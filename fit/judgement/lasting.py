"""What changes in the course of the runs, in all of them alike: no run contradicts another then.

The equation has one stiffness and one ``delta_ifo`` from begin to end of a run. Runs are driven alike: the
test masses by turns, at the same hours. What drifts in all of them alike then passes for another stiffness,
in every run the same. The sum of what they hold tells it where none of them does by itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.estimate import Outcome
from fit.threads import each
from fit.warnings import FitWarning
from fit.weighing import Experiment, linear

Array = NDArray[np.float64]

ALARM = 1e-4  # p-value of all quantities together
ROUNDING = 1e-9  # share of a quantity that must be left beside the parameters
#: What may change, its unit, and what multiplies it in Delta g, by columns of `dynamics.Columns`.
DRIFTING = (
    ("omega2_1", " s-2", {"o_1": -1.0}),
    ("omega2_2", " s-2", {"o_12": 1.0, "o_1": 1.0}),
    ("delta_ifo", "", {"ddo_1": -1.0}),
)


@dataclass(frozen=True)
class _Sums:
    """Sums of products over one run: of what drifts (E), of the parameters (G) and of the residual (r)."""

    EE: Array
    GE: Array
    Er: Array
    Gr: Array


def drifts(experiments: Sequence[Experiment], outcome: Outcome) -> dict[str, tuple[float, float]]:
    """Return by how much what `DRIFTING` names changes from start to end of every run, and the sigmas [SI].

    Parameters
    ----------
    experiments : sequence of Experiment
        Of the joint fit.
    outcome : Outcome
        The joint fit; what it departs by counts with the widths that were found. Each quantity is taken by
        itself, beside all parameters.
    """
    told = [(e, b) for e, b in zip(experiments, outcome.blocks, strict=True) if b.noise is not None]
    if not told:
        return {}
    theta, width = outcome.solution.theta, np.array([p.prior_sigma for p in outcome.parameters])
    found = each(lambda one: _sums(*one, theta, width), told)
    EE, GE, Er, Gr = (sum(getattr(s, name) for s in found) for name in ("EE", "GE", "Er", "Gr"))
    blocks = [block for _, block in told]
    information, scores = (of(blocks, theta) for of in (linear.information, linear.scores))
    rows, off = _known(outcome, width)
    H = width[:, None] * information * width + rows.T @ rows
    beside = np.linalg.solve(H, GE)
    left = np.diag(EE - GE.T @ beside)
    score = Er - beside.T @ (Gr + rows.T @ off)
    telling = np.diag(information) > 0
    windowed = float(np.sqrt(np.mean(np.diag(scores)[telling] / np.diag(information)[telling])))
    return {
        name: (-float(score[k] / left[k]), windowed * float(left[k]) ** -0.5)
        for k, (name, _, _) in enumerate(DRIFTING)
        if left[k] > ROUNDING * EE[k, k]
    }


def _known(outcome: Outcome, width: Array) -> tuple[Array, Array]:
    """Return what is known beside the data: rows for parameters in their natural widths, and how far off."""
    theta, prior = outcome.solution.theta, outcome.prior
    departing = {i: w.name for w in outcome.departing for i in w.members}
    rows, off = [prior.rows * width], [prior.rows @ (theta - prior.centre)]
    for i in departing:
        spread = next(
            s
            for name, (s, _) in outcome.scatter.items()
            if outcome.parameters[i].name.startswith(f"d{name}_")
        )
        rows.append(np.eye(1, theta.size, i) * width[i] / spread)
        off.append(theta[i : i + 1] / spread)
    return np.concatenate(rows), np.concatenate(off)


def changing(experiments: Sequence[Experiment], outcome: Outcome) -> list[FitWarning]:
    """Return a warning of what changes in all runs alike, if chance does not make it."""
    found = drifts(experiments, outcome)
    if not found:
        return []
    name, (amount, sigma) = max(found.items(), key=lambda one: abs(one[1][0]) / one[1][1])
    if len(DRIFTING) * 2 * scipy.stats.norm.sf(abs(amount) / sigma) > ALARM:
        return []
    unit = {of: unit for of, unit, _ in DRIFTING}[name]
    message = (
        f"{name} changes by {amount:.2g} ± {sigma:.1g}{unit} from start to end of the runs, in all of them "
        "alike, or something does that looks like it; the fit knows one value, and the sigmas do not hold"
    )
    return [FitWarning("changing", (), message)]


def _sums(experiment: Experiment, block: linear.Block, theta: Array, width: Array) -> _Sums:
    run, noise = experiment.sysid, block.noise
    assert noise is not None
    terms = run.columns(block.tau)
    share = (terms.time - terms.time.mean()) / np.ptp(terms.time)
    at = {name: terms.values[:, i] for i, name in enumerate(terms.names)}
    series = np.stack([share * sum(a * at[n] for n, a in of.items()) for _, _, of in DRIFTING], axis=1)
    spectra = run.transformed(series, terms)
    weights = np.repeat(np.sqrt(block.weights.fit), 2)[:, None]
    E = linear.stacked(linear.whiten(spectra, noise.expected(spectra.f))[0]) * weights
    U = linear.stacked(block.columns) * weights
    G, r = U @ (block.gradient(theta) * width), U @ block.coefficients(theta)
    return _Sums(E.T @ E, G.T @ E, E.T @ r, G.T @ r)
