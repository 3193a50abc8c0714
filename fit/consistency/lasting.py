"""What all runs have in common that the equation lacks: then no run contradicts another.

The equation has one stiffness and one ``delta_ifo`` from begin to end of a run. Runs are driven alike: the
test masses by turns, at the same hours. What drifts in all of them alike then passes for another stiffness,
in every run the same. An ``o_12`` that is not in proportion to the distance makes test masses that are moved
farther seem softer. An ``o_1`` that is late makes ``delta_ifo`` too small, and no other parameter wrong:
runs of one alignment epoch that were archived alike agree upon it. What such a fault adds to the residual is
known; the sum over the runs tells it where none of them does by itself.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import IRLSResult
from fit.model import dynamics
from fit.parallel import parallel_map
from fit.spectra import Spectra, derivatives
from fit.warnings import FitWarning
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]
_Name = TypeVar("_Name")
#: From a run, those of its columns that faults are in and the coefficients of all to what faults of unit size
#: add to Delta g, Q series of shape (M,) one after the other, None for what is not of that run.
Faults = Callable[[Experiment, dynamics.Columns, Array], Iterator[Array | None]]

ALARM = 1e-4  # p-value of all faults of one kind together
COMMON = 3.0  # sigma, by which a fault stands out of the runs without any one of them: one alone is odd
HARMLESS = 0.4  # s, up to which an o_1 that is late moves delta_ifo by about a sigma at most
ROUNDING = 1e-9  # share of what a fault adds that must be left beside the parameters
#: What may drift, its unit, and what multiplies it in Delta g, by columns of `dynamics.Columns`.
DRIFTING = (
    ("omega2_1", " s-2", {"o_1": -1.0}),
    ("omega2_2", " s-2", {"o_12": 1.0, "o_1": 1.0}),
    ("delta_ifo", "", {"ddo_1": -1.0}),
)
OF_O_1 = ("o_1", "ddo_1")  # columns that o_1 is in
FAR = 1e-8  # m, the amplitude of most injections
BENT = 6.5  # sigma, from which a bend moves omega2_2_0 by about one; of clean runs it is 0.6 +- 1.2
DRIVEN = 0.01  # sigma of that share; more is told by runs that move test mass 2 by far less than 10 nm
SLOW = 2400.0  # s, over which o_12 is averaged: slow motion is larger by far, and what it adds is no harmonic


@dataclass(frozen=True)
class Amount:
    """How much of a fault there is.

    Attributes
    ----------
    value, sigma : float
        In its own unit.
    least : float
        What is left of it without that run without which least is left, in sigmas.
    """

    value: float
    sigma: float
    least: float = np.inf

    @property
    def z(self) -> float:
        """How far it is off nothing, in sigmas."""
        return abs(self.value) / self.sigma

    def stands_out(self, among: int) -> bool:
        """Return whether neither chance makes one of so many amounts as large, nor one run."""
        return bool(among * 2 * scipy.special.ndtr(-self.z) < ALARM and self.least > COMMON)


@dataclass(frozen=True)
class Lasting:
    """What lasts in all runs.

    Attributes
    ----------
    drifts : mapping of str to Amount
        By how much what `DRIFTING` names changes from start to end of every run [SI].
    lags : mapping of int to Amount
        See `lags`.
    bend : Amount or None
        By what share of itself o_12 is too large at `FAR`, growing as the square of the distance.
    """

    drifts: Mapping[str, Amount]
    lags: Mapping[int, Amount]
    bend: Amount | None


def lasting(experiments: Sequence[Experiment], outcome: IRLSResult) -> Lasting:
    """Return how much there is of what all runs may have in common.

    Parameters
    ----------
    experiments : sequence of Experiment
        Of the joint fit.
    outcome : IRLSResult
        The joint fit. Each fault is taken by itself, beside all parameters.
    """
    epochs, n = _epochs(experiments), len(DRIFTING)

    def all_of_them(e: Experiment, terms: dynamics.Columns, c: Array) -> Iterator[Array | None]:
        yield from _drifting(terms)
        yield from _late(epochs, e, terms, c)
        yield _bent(e)

    found = _amounts(experiments, outcome, all_of_them)
    drifts, late = _named([name for name, _, _ in DRIFTING], found[:n]), _named(epochs, found[n:])
    return Lasting(drifts, late, found[-1] if found else None)


def lags(experiments: Sequence[Experiment], outcome: IRLSResult) -> dict[int, Amount]:
    """Return by how much o_1 is late [s] in the runs of each alignment epoch; see `lasting`."""
    epochs = _epochs(experiments)
    return _named(epochs, _amounts(experiments, outcome, partial(_late, epochs)))


def _epochs(experiments: Sequence[Experiment]) -> list[int]:
    return sorted({e.sysid.telemetry.alignment_epoch for e in experiments})


def _named(names: Sequence[_Name], found: Sequence[Amount | None]) -> dict[_Name, Amount]:
    return {name: amount for name, amount in zip(names, found, strict=False) if amount}


def in_common(experiments: Sequence[Experiment], outcome: IRLSResult) -> list[FitWarning]:
    """Return warnings of what all runs, or all of an epoch, have in common, if chance does not make it."""
    found, told = [], lasting(experiments, outcome)
    if told.drifts:
        name, of = max(told.drifts.items(), key=lambda one: one[1].z)
        unit = {name: unit for name, unit, _ in DRIFTING}[name]
        if of.stands_out(len(DRIFTING)):
            message = (
                f"{name} changes by {of.value:.2g} ± {of.sigma:.1g}{unit} from start to end of the runs, in "
                "all of them alike, or something does that looks like it; the fit knows one value, and the "
                "sigmas do not hold"
            )
            found.append(FitWarning("structural_break", (), message))
    late = {k: of for k, of in told.lags.items() if _harms(of, len(experiments))}
    if late:
        words = " and ".join(f"{_told(of)} in the runs of alignment epoch {k}" for k, of in late.items())
        names = tuple(f"delta_ifo_{k}" for k in late)
        found.append(FitWarning("readout_lag", names, f"{words}; the sigmas do not hold"))
    bent = told.bend
    if bent and bent.sigma < DRIVEN and bent.z > BENT and bent.least > COMMON:
        message = (
            f"o_12 is bent: too large by {bent.value:.2g} ± {bent.sigma:.1g} of itself at 10 nm, growing as "
            "the square of the distance, in all of the runs alike, or something does that looks like it; the "
            "sigmas do not hold"
        )
        found.append(FitWarning("readout_nonlinearity", (), message))
    return found


def own_lag(experiment: Experiment, own: IRLSResult, among: int) -> str:
    """Say that o_1 of an experiment, one among so many, is late by its own fit; empty if it is not."""
    of = next(iter(lags([experiment], own).values()), None)
    return _told(of) if of and _harms(of, among) else ""


def _harms(lag: Amount, among: int) -> bool:
    return abs(lag.value) > HARMLESS and lag.stands_out(among)


def _told(of: Amount) -> str:
    """Say that o_1 is late or early."""
    return f"o_1 is {'late' if of.value > 0 else 'early'} by {abs(of.value):.2g} ± {of.sigma:.1g} s"


def _drifting(terms: dynamics.Columns) -> Iterator[Array]:
    time = terms.time
    share = time - time.mean()
    del time
    share /= np.ptp(share)
    at = dict(zip(terms.names, terms.values.T, strict=True))
    for _, _, of in DRIFTING:
        x = np.asarray(sum(a * at[n] for n, a in of.items()))
        x *= share
        yield x
        del x  # before there is another one


def _bent(experiment: Experiment) -> Array:
    run = experiment.sysid.channels
    fast = run.o_12 - scipy.ndimage.uniform_filter1d(run.o_12, round(SLOW * run.fs), mode="nearest")
    return -derivatives.derivative(fast * (fast / FAR) ** 2, run.fs, 2)


def _late(
    epochs: Sequence[int], experiment: Experiment, terms: dynamics.Columns, c: Array
) -> Iterator[Array | None]:
    of_o_1 = [terms.names.index(name) for name in OF_O_1]
    weights = [c[dynamics.COLUMNS.index(name)] for name in OF_O_1]
    slope = np.gradient(terms.values[:, of_o_1] @ weights) * terms.fs
    yield from (slope if epoch == experiment.sysid.telemetry.alignment_epoch else None for epoch in epochs)


@dataclass(frozen=True)
class _Sums:
    """Sums of products over a run: of what faults add (E), of the parameters (G) and of the residual (r)."""

    EE: Array
    GE: Array
    GG: Array
    Er: Array
    Gr: Array

    def beside(self, rows: Array, off: Array) -> tuple[Array, Array]:
        """Return score and information of the faults beside the parameters and what is known of these."""
        held = whitened_run.FLOOR * np.eye(len(self.GG))  # what no run tells
        moved = np.linalg.solve(self.GG + rows.T @ rows + held, self.GE)
        left = np.diag(self.EE - self.GE.T @ moved)
        told = left > ROUNDING * np.diag(self.EE)
        return self.Er - moved.T @ (self.Gr + rows.T @ off), np.where(told, left, 0.0)


def _amounts(experiments: Sequence[Experiment], outcome: IRLSResult, faults: Faults) -> list[Amount | None]:
    """Return how much of each fault there is, None if too little tells it; nothing if no noise is known."""
    told = [(e, b) for e, b in zip(experiments, outcome.blocks, strict=True) if b.noise is not None]
    if not told:
        return []
    theta, width = outcome.solution.theta, np.array([p.prior_sigma for p in outcome.parameters])
    runs = parallel_map(lambda one: _sums(*one, theta, width, faults), told)
    blocks = [block for _, block in told]
    information, scores = (
        np.diag(of(blocks, theta)) for of in (whitened_run.information, whitened_run.scores)
    )
    telling = information > 0
    windowed = float(np.sqrt(np.mean(scores[telling] / information[telling])))
    known = _known(outcome, width)
    score, left = _sum(runs).beside(*known)
    least = np.full(score.size, np.inf)
    for i in range(len(runs)) if len(runs) > 1 else ():
        rest, seen = _sum([*runs[:i], *runs[i + 1 :]]).beside(*known)
        alike = rest * np.sign(score) / np.sqrt(np.where(seen, seen, np.inf))
        least = np.minimum(least, alike / windowed)
    return [
        Amount(-float(s / of), windowed * float(of) ** -0.5, float(z)) if of else None
        for s, of, z in zip(score, left, least, strict=True)
    ]


def _sum(runs: Sequence[_Sums]) -> _Sums:
    return _Sums(*(sum(getattr(run, f.name) for run in runs) for f in fields(_Sums)))


def _known(outcome: IRLSResult, width: Array) -> tuple[Array, Array]:
    """Return what is known beside the data: rows for parameters in their natural widths, and how far off.

    Departures count with the widths that were found for them.
    """
    theta, prior = outcome.solution.theta, outcome.prior
    rows, off = [prior.rows * width], [prior.rows @ (theta - prior.centre)]
    for i in (i for w in outcome.departing for i in w.members):
        own = outcome.parameters[i].name
        spread = next(s for name, (s, _) in outcome.scatter.items() if own.startswith(f"d{name}_"))
        rows.append(np.eye(1, theta.size, i) * width[i] / spread)
        off.append(theta[i : i + 1] / spread)
    return np.concatenate(rows), np.concatenate(off)


def _sums(
    experiment: Experiment, block: whitened_run.WhitenedRun, theta: Array, width: Array, faults: Faults
) -> _Sums:
    noise, c = block.noise, block.coefficients(theta)
    assert noise is not None
    spectra, of_run = _added(experiment, block.tau, c, faults)
    E = whitened_run.stacked(whitened_run.whiten(spectra, noise.expected(spectra.f))[0])
    U = whitened_run.stacked(block.columns)
    weights, at, n = np.repeat(block.weights.fit, 2), np.flatnonzero(of_run), len(of_run)
    r, weighed = weights * (U @ c), weights[:, None] * E
    EE, UE, Er = np.zeros((n, n)), np.zeros((len(c), n)), np.zeros(n)
    EE[np.ix_(at, at)], UE[:, at], Er[at] = E.T @ weighed, U.T @ weighed, E.T @ r
    rows = block.gradient(theta) * width
    GG = width[:, None] * whitened_run.information([block], theta) * width
    return _Sums(EE, rows.T @ UE, GG, Er, rows.T @ (U.T @ r))


def _added(
    experiment: Experiment, tau: tuple[float, float], c: Array, faults: Faults
) -> tuple[Spectra, list[bool]]:
    """Return the spectra of what faults add to a run, and which of them are of that run."""
    terms, of_run = _of_read_outs(experiment.sysid.channels, tau), list[bool]()

    def one_by_one() -> Iterator[Array]:
        for x in faults(experiment, terms, c):
            of_run.append(x is not None)
            if x is not None:
                yield x[:, None]
            del x  # before there is another one

    return experiment.sysid.transformed(one_by_one(), terms), of_run


def _of_read_outs(run: dynamics.Channels, tau: tuple[float, float]) -> dynamics.Columns:
    """Return the columns that `DRIFTING` and `OF_O_1` name; to delay the commands takes the most time."""
    inner = slice(derivatives.HALF, -derivatives.HALF)
    curve = derivatives.derivative(run.o_1, run.fs, 2)
    values = np.empty((curve.size, 3), order="F")
    values[:, 0], values[:, 1], values[:, 2] = run.o_12[inner], run.o_1[inner], curve
    del curve
    valid = ~derivatives.dilate_mask(~run.valid)
    return dynamics.Columns(tau, ("o_12", "o_1", "ddo_1"), run.fs, run.time[inner], values, valid)
