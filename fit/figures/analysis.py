"""Delta g of a run, or D of a LISA spacecraft, and its terms over time, and their spectra."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.figures.series import averaged, glitch_mask
from fit.model import dynamics
from fit.spectra import Binned, Estimator, derivatives
from fit.telemetry import Telemetry
from fit.whitening import Run

Array = NDArray[np.float64]
Series = tuple[Array, Array]

HIGHEST = 1.0  # Hz, shown at most
SLOW, FAST = 200.0, 20.0  # s, lengths of the windows over which the residual is averaged


@dataclass(frozen=True)
class Terms:
    """Delta g of a run, or a component of D, and its terms, up to the `HIGHEST` frequency shown.

    Attributes
    ----------
    fs : float
        Sample rate [Hz].
    time : ndarray, shape (N,)
        Seconds since the start of the run.
    valid : ndarray of bool, shape (N,)
        False where samples are missing.
    delta_g : ndarray, shape (N,)
        The sum of all terms [m s^-2].
    terms : mapping of str to ndarray, each of shape (N,)
        The terms, with their signs, that are not zero throughout [m s^-2].
    """

    fs: float
    time: Array
    valid: NDArray[np.bool_]
    delta_g: Array
    terms: Mapping[str, Array]


def split(telemetry: Telemetry, parameters: Mapping[str, float]) -> Terms:
    """Return the terms of Delta g; of a noise run only their sum.

    Parameters
    ----------
    telemetry : Telemetry
        The run.
    parameters : mapping
        Those of `fit.model.dynamics.residual`.
    """
    run = dynamics.wideband_channels(telemetry, HIGHEST)
    theta = np.array([parameters.get(name, 0.0) for name in run.parameters])
    columns = dynamics.columns(run, dynamics.delays(theta))
    terms = {} if telemetry.kind == "noise" else dynamics.terms(columns, theta)
    driven = {name: term for name, term in terms.items() if np.any(term)}
    return Terms(run.fs, columns.time, columns.valid, dynamics.total(columns, theta), driven)


def split_component(telemetry: Telemetry, parameters: Mapping[str, float], index: int) -> Terms:
    """Return the terms of an equation of a run; of a noise run only their sum.

    Parameters
    ----------
    telemetry : Telemetry
        The run.
    parameters : mapping
        By name.
    index : int
        Number of the equation.
    """
    run = Run(telemetry)
    equation = run.equations[index]
    theta = equation.parameters_of(parameters)
    columns = run.columns(run.spacecraft.delays_of(theta, equation.parameters))
    terms = equation.terms(columns, theta)
    total = np.sum(list(terms.values()), axis=0)
    driven = {} if telemetry.kind == "noise" else {name: x for name, x in terms.items() if np.any(x)}
    return Terms(columns.fs, columns.time, columns.valid, total, driven)


@dataclass(frozen=True)
class Analysis:
    """Residual of a run over time, and spectra of the terms that are not zero throughout.

    Series are pairs of hours since the start of the run and values [fm s^-2] less their mean, NaN where
    samples are missing; None for a run without valid samples.

    Attributes
    ----------
    fs : float
        Sample rate [Hz].
    missing, masked : ndarray, shape (G, 2)
        Begin and end of every stretch where samples are missing, and of glitches [h since the start].
    fast, slow : tuple of ndarray, or None
        Delta g averaged over `FAST` and over `SLOW`.
    signal : tuple of ndarray, or None
        Second derivative of o_12 (of D: relative acceleration) averaged over `FAST`; None of a noise run.
    asd : Binned or None
        Of Delta g outside the masked intervals; None of a simulation without noise.
    terms : mapping of str to Binned
        Of its terms; none of a noise run.
    """

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
) -> Analysis:
    """Analyse a run of LISA Pathfinder for its figures; see `split` and `analyse_terms`."""
    return analyse_terms(split(telemetry, parameters), float(telemetry.time[0]), "ddo_12", masked)


def analyse_terms(
    run: Terms,
    start: float,
    signal_term: str,
    masked: Sequence[tuple[float, float]] = (),
    *,
    rising_noise: bool = False,
) -> Analysis:
    """Analyse the terms of a run for its figures.

    The spectrum of Delta g excludes the `masked` intervals, begin and end [s], unless they cover half of it.

    Parameters
    ----------
    run : Terms
        The terms of the run.
    start : float
        Its first time [s].
    signal_term : str
        The term that has the injected signal.
    masked : sequence of tuple of float
        Begin and end [s] of glitches.
    rising_noise : bool
        See `fit.spectra.Estimator`.
    """
    asd, spectra = None, {}
    if run.valid.any():
        estimator = Estimator(run.valid, run.fs, HIGHEST, rising_noise=rising_noise)
        spectra = {name: estimator.asd(term) for name, term in run.terms.items()}
        unmasked = run.valid & ~glitch_mask(run.time, masked)
        if np.any(run.delta_g[run.valid]):
            is_partial = run.valid.sum() > unmasked.sum() > unmasked.size / 2
            if is_partial:
                estimator = Estimator(unmasked, run.fs, HIGHEST, rising_noise=rising_noise)
            asd = estimator.asd(run.delta_g)
    signal = run.terms.get(signal_term)
    return Analysis(
        run.fs,
        (derivatives.true_runs(~run.valid) / run.fs + run.time[0] - start) / 3600,
        (np.reshape(masked, (-1, 2)) - start) / 3600,
        _averages(run, run.delta_g, FAST, start),
        _averages(run, run.delta_g, SLOW, start),
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
