"""The residual of a run that is whitened by its noise run and fitted by itself, and templates in it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.spacecraft import DELTA_G
from fit.spectra import windowing
from fit.statistics.fault_templates import MODEL_TEMPLATES, RunSeries
from fit.statistics.initial_fit import initial_fit, initial_noise_psd
from fit.statistics.score_test import ScoreTest
from fit.whitening import Experiment, Run, whitened_run

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DRIVEN = 14.0  # amplitude of o_12'' in units of the noise, from which a bin is driven
NEIGHBOURS = 60  # bins at most that give the level of the noise around a driven one
MIN_NEIGHBOURS = 8  # half of them below it: the lowest bins have no level, and do not count
EFFECTIVE = 0.3  # degrees of freedom of that level by those of the driven bins: neighbours are shared
CHANCE = 3.0  # standard deviations of the sum of the power, that noise may make
ITERATIONS = 4  # of parameters that equations share, nearly linear


@dataclass(frozen=True)
class RunMisfit:
    """The residual of a run with coefficients of its own.

    Attributes
    ----------
    experiment : Experiment
        The run.
    f : ndarray, shape (B,)
        Frequencies [Hz].
    driven : ndarray of bool, shape (B,)
        Which bins are driven.
    sine_amplitude : ndarray, shape (B,)
        Amplitude [m s^-2] of a sine that lasts all of the run and has the whitened amplitude 1.
    test : ScoreTest
        Of further effects, 2 B rows.
    variance : float
        By how much the window makes amounts vary more than independent bins would.
    effects : ndarray, shape (2 B, Q)
        Whitened, of the templates, without what is refitted; none for other equations.
    """

    experiment: Experiment
    f: Array
    driven: Flags
    sine_amplitude: Array
    test: ScoreTest
    variance: float
    effects: Array

    def power(self, amounts: Array | None = None) -> Array:
        """Return the power of the residual without some amounts of the templates, 1 for noise, shape (B,)."""
        r = self.test.residual
        if amounts is not None:
            r = r - self.effects @ amounts
        return np.asarray(np.sum(r.reshape(-1, 2) ** 2, axis=1) / 2)

    @cached_property
    def sums(self) -> Array:
        """Information and score, ``e' P e`` and ``e' P r``, of every template e, shape (Q, 2)."""
        e = self.effects
        return np.column_stack([np.sum(e**2, axis=0), e.T @ self.test.residual])

    def relative_power(self) -> Array:
        """Return the power of driven bins by the level of the noise, that of the noise run at least.

        The level is the mean of the next undriven bins or the median of as many bins below as above, if the
        noise departs from its model at the lowest frequencies: all of these may be driven.
        """
        power, n = self.power(), self.driven.size
        driven = np.flatnonzero(self.driven)
        driven = driven[(driven >= MIN_NEIGHBOURS // 2) & (driven < n - MIN_NEIGHBOURS // 2)]
        half = np.minimum(np.minimum(driven, n - 1 - driven), NEIGHBOURS // 2)
        medians = [np.median(power[i - m : i + m + 1]) for i, m in zip(driven, half, strict=True)]
        level = np.maximum(np.array(medians) / np.log(2), 1.0)
        undriven = np.flatnonzero(~self.driven)
        if undriven.size >= NEIGHBOURS:
            sums = np.concatenate([[0.0], np.cumsum(power[undriven])])
            begin: NDArray[np.intp] = np.clip(
                np.searchsorted(undriven, driven) - NEIGHBOURS // 2, 0, undriven.size - NEIGHBOURS
            )
            level = np.maximum(level, (sums[begin + NEIGHBOURS] - sums[begin]) / NEIGHBOURS)
        return np.asarray(power[driven] / level)

    def excess(self, amounts: Array | None = None) -> float:
        """Return the excess over all bins, as far as the noise does not make it, whatever its level."""
        power = self.power(amounts)
        level = max(1.0, float(np.median(power)) / np.log(2))
        chance = float(np.sqrt(self.variance * power.size))
        return max(0.0, float(np.sum(power / level - 1)) - CHANCE * chance)

    @cached_property
    def p(self) -> float:
        """Return an upper limit of how often noise makes the driven bins as loud.

        The level of the noise, that of the noise run at least, comes from bins that driven ones share, with
        few degrees of freedom (`EFFECTIVE`): p of twelve clean runs was 0.66 to 0.98.
        """
        ratios = self.relative_power()
        dof = 2 * ratios.size / self.variance
        return float(scipy.special.fdtrc(dof, EFFECTIVE * dof, np.mean(ratios))) if dof else 1.0


def run_misfit(experiment: Experiment, largest_force: tuple[float, float]) -> RunMisfit:
    """Fit a run with parameters of its own.

    Parameters
    ----------
    experiment : Experiment
        With a noise run.
    largest_force : tuple of float
        See `RunSeries`.
    """
    run = experiment.sysid
    tau = initial_fit(run).tau
    terms = run.spectra(tau)
    PSDs = [initial_noise_psd(experiment, k).expected(terms.f) for k in range(len(run.equations))]
    whitened = [
        whitened_run.as_real(whitened_run.whiten(equation.spectra(terms), S)[0])
        for equation, S in zip(run.equations, PSDs, strict=True)
    ]
    signal = np.concatenate([U[:, 0] for U in whitened])
    w, f, S = terms.window, np.tile(terms.f, len(PSDs)), np.concatenate(PSDs)
    misfit = RunMisfit(
        experiment=experiment,
        f=f,
        driven=np.linalg.norm(signal.reshape(-1, 2), axis=1) > DRIVEN * np.sqrt(2),
        sine_amplitude=np.sqrt(S * (w @ w) * run.channels.fs) / w.sum(),
        test=_refitted(run, whitened, tau),
        variance=windowing.variance_factor(w),
        effects=np.zeros((2 * f.size, 0)),
    )
    if [equation.name for equation in run.equations] != [DELTA_G.name]:  # whose templates these are
        return misfit
    test, columns = misfit.test, run.columns(tau)
    c = np.array([1.0, *-test.amounts])
    series = RunSeries(run, columns, c, largest_force)
    none = np.zeros(len(columns.values))
    values = np.stack([none if (x := t.effect(series)) is None else x for t in MODEL_TEMPLATES], axis=1)
    effects = whitened_run.as_real(whitened_run.whiten(run.transformed(values, columns), S)[0])
    return replace(misfit, effects=test.independent(effects))


def _refitted(run: Run, whitened: Sequence[Array], tau: tuple[float, float]) -> ScoreTest:
    """Return the residual of the whitened columns of each equation, its parameters refitted."""
    if len(whitened) == 1:  # a coefficient for each parameter
        return ScoreTest(whitened[0][:, 0], whitened[0][:, 1:])
    names = run.channels.parameters
    values = {p.name: p.value for p in run.spacecraft.parameters(run.telemetry, names)}
    theta = np.array([values[name] for name in names])
    for _ in range(ITERATIONS):
        pairs = list(zip(whitened, run.equations, strict=True))
        residual = np.concatenate([U @ e.coefficients(theta, tau) for U, e in pairs])
        test = ScoreTest(residual, np.concatenate([U @ e.gradient(theta, tau) for U, e in pairs]))
        theta = theta - test.amounts
    return test
