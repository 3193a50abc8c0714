"""The equations of a run, Delta g or D_x and D_y, their terms over time, and their spectra."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.figures.series import averaged, glitch_mask
from fit.model import Equation
from fit.spacecraft import Terms, equation_terms, spacecraft_of
from fit.spectra import Binned, Estimator, derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]
Series = tuple[Array, Array]

HIGHEST = 1.0  # Hz, shown at most
SLOW, FAST = 200.0, 20.0  # s, lengths of the windows over which the residual is averaged


def split(telemetry: Telemetry, parameters: Mapping[str, float]) -> tuple[Terms, ...]:
    """Return the terms of each equation of a run up to the `HIGHEST` frequency shown, of a noise run none.

    Parameters
    ----------
    telemetry : Telemetry
        The run.
    parameters : mapping
        By name; what is not in it counts as zero.
    """
    of_run = equation_terms(spacecraft_of(telemetry), telemetry, parameters, HIGHEST)
    return of_run if telemetry.kind != "noise" else tuple(replace(one, terms={}) for one in of_run)


@dataclass(frozen=True)
class Analysis:
    """Residual of a run over time, and spectra of the terms that are not zero throughout.

    Series are pairs of hours since the start of the run and values [fm s^-2] less their mean, NaN where
    samples are missing; None for a run without valid samples.

    Attributes
    ----------
    equation : Equation
        Which.
    fs : float
        Sample rate [Hz].
    missing, masked : ndarray, shape (G, 2)
        Begin and end of every stretch where samples are missing, and of glitches [h since the start].
    fast, slow : tuple of ndarray, or None
        The residual averaged over `FAST`, None where noise rises, and over `SLOW`.
    signal : tuple of ndarray, or None
        Term of the injected signal averaged over `FAST`; None of a noise run.
    asd : Binned or None
        Of the residual outside the masked intervals; None of a simulation without noise.
    terms : mapping of str to Binned
        Of its terms; none of a noise run.
    """

    equation: Equation
    fs: float
    missing: Array
    masked: Array
    fast: Series | None
    slow: Series | None
    signal: Series | None
    asd: Binned | None
    terms: Mapping[str, Binned]


def analyse(
    telemetry: Telemetry, parameters: Mapping[str, float], masked: Sequence[tuple[float, float]] = ()
) -> tuple[Analysis, ...]:
    """Analyse each equation of a run for its figures.

    The spectrum of the residual excludes the `masked` intervals, begin and end [s], unless they cover half of
    it. Averages over `FAST` are left out where noise rises with frequency: they would hide the slow ones.

    Parameters
    ----------
    telemetry : Telemetry
        The run.
    parameters : mapping
        See `split`.
    masked : sequence of tuple of float
        Begin and end [s] of glitches.
    """
    rising_noise, start = spacecraft_of(telemetry).rising_noise, float(telemetry.time[0])
    terms = split(telemetry, parameters)
    return tuple(_analyse(of_equation, start, masked, rising_noise) for of_equation in terms)


def _analyse(run: Terms, start: float, masked: Sequence[tuple[float, float]], rising_noise: bool) -> Analysis:
    asd, spectra = None, {}
    if run.valid.any():
        estimator = Estimator(run.valid, run.fs, HIGHEST, rising_noise=rising_noise)
        spectra = {name: estimator.asd(term) for name, term in run.terms.items()}
        unmasked = run.valid & ~glitch_mask(run.time, masked)
        if np.any(run.total[run.valid]):
            is_partial = run.valid.sum() > unmasked.sum() > unmasked.size / 2
            if is_partial:
                estimator = Estimator(unmasked, run.fs, HIGHEST, rising_noise=rising_noise)
            asd = estimator.asd(run.total)
    signal = run.terms.get(run.equation.signal)
    return Analysis(
        run.equation,
        run.fs,
        (derivatives.true_runs(~run.valid) / run.fs + run.time[0] - start) / 3600,
        (np.reshape(masked, (-1, 2)) - start) / 3600,
        None if rising_noise else _averages(run, run.total, FAST, start),
        _averages(run, run.total, SLOW, start),
        None if signal is None else _averages(run, signal, FAST, start),
        asd,
        spectra,
    )


def _averages(run: Terms, x: Array, length: float, start: float) -> Series | None:
    """Return averages over windows of `length` [s]: hours since `start`, and fm s^-2 less their mean."""
    if not run.valid.any():
        return None
    stride = max(1, round(length / 4 * run.fs))
    means = averaged(np.where(run.valid, x, np.nan), length * run.fs, stride)
    mean = np.nansum(means) / max(np.isfinite(means).sum(), 1)
    return (run.time[::stride] - start) / 3600, 1e15 * (means - mean)
