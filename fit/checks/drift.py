"""Coefficients that change within runs, slowly or at once: gains, delays and stiffness are constant in a fit.

A coefficient that follows the temperature, drifts or jumps leaves its column in the residual, times its
course. The test is that of a wave of some period: the driven part d of a whitened column, times sine and
cosine, with the residual r of the fit and what is refitted projected out,

    chi^2 = G' A^-1 G ,    G = (d cos, d sin)' r ,    A = (d cos, d sin)' P (d cos, d sin) .

A slope and a step are waves as well, of about twice the run. All parameters are refitted in every run, which
leaves their scatter between runs out of the test. Runs need not agree on the phase, so that the chi^2 of
several runs has two degrees of freedom for each of them.

Only bins that some column drives count: elsewhere the commands answer the noise. Sums over products of series
are those of blocks of `BLOCK`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.agreement import Agreement
from fit.campaign import Campaign
from fit.errors import FitError
from fit.false_alarms import p_limit
from fit.findings import Finding
from fit.fitting import IRLSResult
from fit.model import dynamics
from fit.parallel import parallel_map
from fit.spectra import windowing
from fit.whitening import Experiment, WhitenedRun, whitened_run

Array = NDArray[np.float64]

DRIFT = "drift"  # code of the warning
DRIVEN = 10.0  # amplitude of the term of a column, in units of the noise, from which a bin is driven
BLOCK = 300.0  # s
SHORTEST = 1800.0  # s, period: six blocks
INDEPENDENT = 3e-3  # share of a wave that refitted columns must leave
REMAINING = 1e-2  # probability below which a drift of the equation shows without any one run too
NOISY = frozenset(dynamics.CROSS_TALK)  # columns with the read-out noise of the spacecraft's motion


@dataclass(frozen=True)
class Waves:
    """What waves of N periods do in one coefficient of one run.

    Attributes
    ----------
    chi2, dof : ndarray, shape (N,)
        By how much chi^2 falls, for how many degrees of freedom.
    amplitude : ndarray, shape (N,)
        Of the coefficient, over it.
    """

    chi2: Array
    dof: Array
    amplitude: Array


@dataclass(frozen=True)
class Drift:
    """A coefficient that changes.

    Attributes
    ----------
    column : str
        Which it multiplies.
    period : float
        Of the wave that fits best [s].
    amplitude : float
        Its size over the coefficient, root mean square of the runs; large for a coefficient of zero.
    chi2, dof : float
        By how much chi^2 falls, for how many degrees of freedom.
    p : float
        Probability that noise does that.
    """

    column: str
    period: float
    amplitude: float
    chi2: float
    dof: float
    p: float

    @property
    def words(self) -> str:
        """What changes, how fast and by how much."""
        size = f" by {100 * self.amplitude:.2g} %" if self.amplitude < 1 else ""
        return (
            f"the coefficient of {self.column} changes{size} within the run, as a drift or a wave of "
            f"{self.period / 3600:.2g} h does (chi2 = {self.chi2:.4g} for {self.dof:.0f} degrees of freedom)"
        )


def find_drift(runs: Sequence[Mapping[str, Waves]], periods: Array, limit: float) -> list[Drift]:
    """Return the coefficient that changes most clearly within runs, nothing if none does.

    Parameters
    ----------
    runs : sequence of mapping of str to Waves
        By column, of runs in one equation.
    periods : ndarray, shape (N,)
        Of the waves [s].
    limit : float
        Probability of a false alarm.
    """
    drifts = []
    for name in dict.fromkeys(name for run in runs for name in run):
        of_runs = [run[name] for run in runs if name in run]
        chi2, dof = (np.sum([getattr(w, key) for w in of_runs], axis=0) for key in ("chi2", "dof"))
        amplitude = np.sqrt(np.mean([w.amplitude**2 for w in of_runs], axis=0))
        p = scipy.special.chdtrc(np.maximum(dof, 1), chi2)
        n = int(np.lexsort((-chi2, p))[0])
        drifts.append(Drift(name, *(float(x[n]) for x in (periods, amplitude, chi2, dof, p))))
    drifts.sort(key=lambda drift: (drift.p, -drift.chi2))
    return [drift for drift in drifts[:1] if drift.p * periods.size * len(drifts) < limit]


def wave_periods(runs: Sequence[WhitenedRun]) -> Array:
    """Return the periods of waves [s] that runs are tested for, shape (N,)."""
    duration = max((run.first_bin / float(run.f[0]) for run in runs if run.f is not None), default=0.0)
    return 2 * duration / np.arange(1, max(1, int(2 * duration / SHORTEST)) + 1)


def waves(run: WhitenedRun, theta: Array, periods: Array) -> dict[str, Waves]:
    """Return by column what waves do in a run with a PSD and a window, at theta, shape (P,)."""
    assert run.window is not None and run.f is not None
    c, names = run.coefficients(theta), run.equation.columns
    U = run.columns * np.sqrt(run.weights.fit)[:, None]
    is_driven = np.abs(U * c) > DRIVEN
    if run.noise:  # below its knots the PSD is an extrapolation
        is_driven &= (np.log(run.f) > run.noise.knots[0] - 1e-9)[:, None]
    driven_columns = {name for name, bins in zip(names, is_driven.T, strict=True) if bins.any()}
    tested = [  # the delay of a command multiplies its slope; the noise of some columns passes for a change
        k
        for k, name in enumerate(names)
        if {name, name.removeprefix("d")} & driven_columns and name not in NOISY and U[:, k].any()
    ]
    excess = max(1.0, float(np.mean(np.abs(U @ c) ** 2)) / 2)
    U = U / np.sqrt(windowing.variance_factor(run.window) * excess)
    refitted = whitened_run.as_real(U @ run.run_gradient(theta))
    norms = np.linalg.norm(refitted, axis=0)
    Q = np.linalg.qr(refitted[:, norms > 0] / norms[norms > 0])[0]
    r = whitened_run.as_real((U @ c)[:, None])
    real = np.hstack([r - Q @ (Q.T @ r), Q])
    d = np.where(np.any(is_driven, axis=1)[:, None], U[:, tested], 0)
    bins = np.hstack([np.ascontiguousarray(real.T).view(np.complex128).T, d])
    m = min(scipy.fft.next_fast_len(4 * (run.first_bin + len(d)), real=True), run.window.size)
    series = windowing.inverse_transform(bins, run.first_bin, m) * np.sqrt(m / 2)
    step = run.first_bin / run.f[0] / m  # s
    starts = np.arange(0, m, max(1, round(BLOCK / step)))
    phase = 2 * np.pi * (starts + BLOCK / step / 2) * step / periods[:, None]
    W = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    results = {}
    for k, x in zip(tested, series[:, real.shape[1] :].T[:, :, None], strict=True):
        products = np.add.reduceat(x * np.hstack([series[:, : real.shape[1]], x]), starts, axis=0)
        G, of_refitted = W @ products[:, 0], W @ products[:, 1:-1]
        whole = np.einsum("nig,g,njg->nij", W, products[:, -1], W)
        unit = 1 / np.sqrt(np.maximum(np.diagonal(whole, axis1=1, axis2=2), 1e-300))
        A = (whole - of_refitted @ of_refitted.swapaxes(1, 2)) * unit[:, :, None] * unit[:, None]
        values, vectors = np.linalg.eigh(A)
        z = np.einsum("nji,nj->ni", vectors, G * unit)
        inverse = np.where(values > INDEPENDENT, 1 / np.maximum(values, INDEPENDENT), 0)
        amounts = np.einsum("nij,nj->ni", vectors, z * inverse) * unit
        amplitude = np.linalg.norm(amounts, axis=1) / max(abs(float(c[k])), 1e-300)
        results[names[k]] = Waves(np.sum(z**2 * inverse, axis=1), np.sum(inverse > 0, axis=1), amplitude)
    return results


def find(campaign: Campaign) -> list[Finding]:
    """Return in which experiments a coefficient changes, by their own fits."""
    experiments, fits = campaign.usable, campaign.fits
    n = len(experiments)

    def of_run(e: Experiment) -> list[Drift]:
        fit = fits[e.name]
        if isinstance(fit, FitError):
            return []
        blocks = _blocks(fit)
        periods, limit = wave_periods(blocks), p_limit(n * len(blocks))
        tables = [waves(block, fit.solution.theta, periods) for block in blocks]
        drifts = [drift for table in tables for drift in find_drift([table], periods, limit)]
        return sorted(drifts, key=lambda drift: (drift.p, -drift.chi2))[:1]

    drifts = parallel_map(of_run, experiments, Experiment.samples)
    return [
        Finding(DRIFT, f"{e.sysid.telemetry.path}: {drift.words}", e.name, drift.column)
        for e, run_drifts in zip(experiments, drifts, strict=True)
        for drift in run_drifts
    ]


def find_joint(agreed: Agreement) -> list[Finding]:
    """Return the coefficients that change within the runs of a joint fit."""
    fit = agreed.outcome
    blocks = _blocks(fit)
    names = dict.fromkeys(block.equation.name for block in blocks)
    periods, limit = wave_periods(blocks), p_limit(len(names))
    findings = []
    for name in names:
        members = [block for block in blocks if block.equation.name == name]
        runs = [waves(block, fit.solution.theta, periods) for block in members]
        for block, of_run in zip(members, runs, strict=True):
            if NOISY & {*block.equation.columns}:  # the read-out holds that noise too, as the residual does
                of_run.pop(block.equation.columns[0], None)
        # what one run alone shows, such as the rest of a glitch, is none of the equation
        subsets = [[*runs[:i], *runs[i + 1 :]] for i in range(len(runs))] if len(runs) > 1 else []
        for drift in find_drift(runs, periods, limit):
            if all(find_drift(rest, periods, REMAINING) for rest in subsets):
                message = (
                    f"in {len(fit.whitened_runs)} runs together {drift.words}; the equation has constant "
                    "coefficients, and the uncertainties are not valid"
                )
                findings.append(Finding(DRIFT, message, channel=drift.column))
    return findings


def _blocks(fit: IRLSResult) -> list[WhitenedRun]:
    """Return the runs of a fit in each of their equations, as far as they have a PSD and a window."""
    blocks = [block for run in fit.whitened_runs for block in run.blocks]
    return [block for block in blocks if block.window is not None and block.f is not None]
