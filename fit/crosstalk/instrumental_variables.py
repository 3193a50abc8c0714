"""Unbiased couplings from noisy read-outs: b_3 to b_6 by instruments (eq. bump).

The capacitive y and z carry as much noise n as motion at the end of the band, so that least squares finds
b_3 to b_6 too small. The two test masses read the same motion with noises of their own. In the mean of
their read-outs, c = y + m with m = (n_1 + n_2) / 2, the power S_m of m is that of d = (n_2 - n_1) / 2, half
of what they differ by once rotation is taken off. With each read-out as the instrument for the other, the
normal equations have |c|^2 - S_m in the place of |c|^2. Below some 20 mHz the masses themselves move apart;
S_m is measured above, where it must be white.

That alone is not enough. The drag-free loop steers after these read-outs, and the spacecraft follows their
noise: y = j - T m, of which the instruments see

    E[c* m] = (1 - T*) S_m .

Above the bandwidth T is small, near it a few per cent of b_3 hang on it, and nobody tells its shape. But T
is causal: the spacecraft answers to noise after it was read, not before. So T is fitted along, as a sum of
causal (Laguerre) functions t_k T_k. Instruments for the t_k are c times T_k* S_m / S_c, the shapes in which
c tells m. A bin has no say in the S_c it is divided by: what it told of itself would tie the instruments to
the very noise they are to be free of, and pull b back by some 0.2 sigma. In the time domain, the half of the
correlation of residual and read-outs in which the read-out comes first then tells b_3, and the other half
the loop. That costs a factor of two to three in sigma.

What is subtracted from Delta g_x stays least squares: that subtracts best, attenuated or not.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.crosstalk import instruments
from fit.crosstalk.instruments import OF, ORDER, Mean, Moments, Weighed
from fit.fitting import IRLSResult, normal
from fit.model import dynamics
from fit.spectra import Spectrum, windowing
from fit.whitening import whitened_run

Array = NDArray[np.float64]

FREE = 30.0  # width of the weak prior of t_k, about zero: the largest T is some 2
WEAK = 10.0  # times the sigma of least squares: instruments that tell less are none, unless it is off by more
DROWNED = 0.7  # share of noise in what the data say, from which instruments tell nothing


@dataclass(frozen=True)
class Freed:
    """What instruments make of a fit.

    Attributes
    ----------
    outcome : IRLSResult
        The fit, with their estimate as its solution.
    names : frozenset of str
        The parameters they free of attenuation.
    """

    outcome: IRLSResult
    names: frozenset[str]


def free(outcome: IRLSResult, weighed: Sequence[Weighed], off: Mapping[str, float]) -> Freed:
    """Free b_3 to b_6 of attenuation, wherever all runs of an alignment epoch have the instruments for it.

    All else is solved along, so that nothing is held at what attenuated coefficients made of it.

    Parameters
    ----------
    outcome : IRLSResult
        Of the joint fit.
    weighed : sequence of Weighed
        Its runs.
    off : mapping of str to float
        Parameters that read-out noise shifts, and by how many sigma; NaN where that cannot be told. A mean of
        which none is among them keeps least squares and its smaller sigma.

    Raises
    ------
    FitError
        If a noise PSD cannot be fitted.
    """
    if any(w.block.window is None for w in weighed):
        return Freed(outcome, frozenset())
    theta = outcome.solution.theta
    found = [
        {name: instruments.mean(w, name, theta) for name in OF if name in w.experiment.sysid.channels.means}
        for w in weighed
    ]
    every = [(w, name, mean) for w, means in zip(weighed, found, strict=True) for name, mean in means.items()]
    places = {(_epoch(w), name) for w, name, _ in every if _is_off(outcome, w, name, off)}
    places -= {(_epoch(w), name) for w, name, mean in every if mean is None}

    def moments(kept: Sequence[tuple[int, str]]) -> list[Moments]:
        return [
            _moments(w, outcome, [m for m in means.values() if m and m.place in kept], kept)
            for w, means in zip(weighed, found, strict=True)
        ]

    while places:
        runs = moments(sorted(places))
        useless = _drowned(outcome, runs)
        if not useless:
            solution = _solved(outcome, runs)
            cost = solution.sigma / outcome.solution.sigma
            worth = [np.fmax(WEAK, abs(off.get(p.name, 0.0))) for p in outcome.parameters]
            useless = {
                mean.place
                for run in runs
                for mean, j in zip(run.means, run.accelerations, strict=True)
                if cost[j] > worth[j]
            }
        if not useless:
            names = frozenset(outcome.parameters[j].name for run in runs for j in run.freed)
            return Freed(replace(outcome, solution=solution), names)
        places -= useless
    return Freed(outcome, frozenset())


def _epoch(w: Weighed) -> int:
    return w.experiment.sysid.telemetry.alignment_epoch


def _is_off(outcome: IRLSResult, w: Weighed, name: str, off: Container[str]) -> bool:
    """Tell whether a coefficient of a mean is off; none is, if that of its acceleration is lost."""
    rows = w.block.share[[w.experiment.parameters.index(b) for b in OF[name]]]
    made_of = [
        p.name for p, used in zip(outcome.parameters, np.any(rows, axis=0).tolist(), strict=True) if used
    ]
    return not outcome.lost[rows[0] != 0].any() and any(parameter in off for parameter in made_of)


def _moments(
    w: Weighed, outcome: IRLSResult, means: Sequence[Mean], places: Sequence[tuple[int, str]]
) -> Moments:
    theta, K, P = w.block.share @ outcome.solution.theta, *w.block.share.shape
    U, _ = whitened_run.whiten(w.terms, w.S)
    regressors: Spectrum = U @ dynamics.gradient(theta, w.terms.tau)
    weights = w.block.weights.fit
    # Filtered first and projected then: what the projection spreads over all bins is far below the motion
    # there, but far above it in the lowest, which the filters of a slow force weigh most.
    loops: list[Spectrum] = [
        whitened_run.whiten(
            replace(w.terms, columns=mean.filters[:, 2:] * w.terms.columns[:, [mean.at[0] + 1]]), w.S
        )[0]
        for mean in means
    ]
    to_run = np.zeros((K + ORDER * len(means), P + ORDER * len(places)))
    to_run[:K, :P] = w.block.share
    for i, mean in enumerate(means):
        first = P + ORDER * places.index(mean.place)
        to_run[K + i * ORDER : K + (i + 1) * ORDER, first : first + ORDER] = np.eye(ORDER)
    assert w.block.window is not None
    return Moments(
        tuple(means),
        regressors,
        np.asarray(np.concatenate([regressors, *loops], axis=1) * weights[:, None], dtype=np.complex128),
        U @ dynamics.coefficients(theta, w.terms.tau),
        theta,
        to_run,
        windowing.variance_factor(w.block.window),
        weights,
    )


def _drowned(outcome: IRLSResult, runs: Sequence[Moments]) -> set[tuple[int, str]]:
    """Return the means whose noise is nearly all that the data say in some direction."""
    P = outcome.solution.theta.size
    width = np.array([p.prior_sigma for p in outcome.parameters])
    held = outcome.held.rows
    H = whitened_run.information(outcome.blocks, outcome.solution.theta) + held.T @ held
    root = np.linalg.inv(np.linalg.cholesky(H * np.outer(width, width))) * width
    of_place: dict[tuple[int, str], Array] = {}
    for run in runs:
        for mean, C in zip(run.means, run.noise, strict=True):
            total = of_place.setdefault(mean.place, np.zeros((P, P)))
            total += (run.map.T @ C @ run.map)[:P, :P]
    return {place for place, C in of_place.items() if np.linalg.eigvalsh(root @ C @ root.T)[-1] > DROWNED}


def _solved(outcome: IRLSResult, runs: Sequence[Moments]) -> whitened_run.Solution:
    """Solve the moments of all runs for what changes least squares."""
    theta, held = outcome.solution.theta, outcome.held
    extra = runs[0].map.shape[1] - theta.size
    rows = np.zeros((len(held.rows) + extra, theta.size + extra))
    rows[: len(held.rows), : theta.size] = held.rows
    rows[len(held.rows) :, theta.size :] = np.eye(extra) / FREE
    away = np.concatenate([theta - held.centre, np.zeros(extra)])
    A = rows.T @ rows + np.sum([run.map.T @ run.A @ run.map for run in runs], axis=0)
    here = rows.T @ (rows @ away)
    for run in runs:
        here += run.map.T @ run.bins(np.zeros(len(run.map))).sum(axis=0)
    inverse = normal.inverse(A)
    change = -inverse @ here
    scores = rows.T @ rows
    for run in runs:
        scores += run.scores(run.map @ change)
    covariance = (inverse @ scores @ inverse.T)[: theta.size, : theta.size]
    symmetric = (covariance + covariance.T) / 2
    return replace(outcome.solution, theta=theta + change[: theta.size], covariance=symmetric)
