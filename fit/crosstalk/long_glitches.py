"""Glitches in long noise runs, at the low frequencies of the inertial fit.

There a mask would cost hours and leak, so that every glitch becomes a column of the run: a shape of the bank
of `glitches` with an amplitude. What it leaves of the glitch is found by the next round.
"""

from collections.abc import Sequence
from contextlib import suppress
from math import floor

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.checks import glitches
from fit.errors import FitError
from fit.findings import Finding
from fit.spectra import NoiseModel, Spectra, fit_noise, windowing
from fit.statistics import lstsq_coefficients
from fit.whitening import whitened_run

Array = NDArray[np.float64]

RATE = 25.0  # samples per cycle of the highest frequency of the band
TAIL = 25.0  # tau, after which nothing is left of a glitch
MAX_PER_DAY = 6.0  # shapes; beyond, it is no matter of glitches
BURIED = 1e12  # power that stands for bins below the band, without information


def columns(long_glitches: Sequence[glitches.Glitch], time: Array, fs: float, f_max: float) -> Array:
    """Return glitches at instants [s] of rate `fs`, shape (N, G), without what is far above `f_max` [Hz]."""
    values = np.empty((time.size, len(long_glitches)))
    for column, (shape, tau, instant) in zip(values.T, long_glitches, strict=True):
        n = scipy.fft.next_fast_len(time.size + int(TAIL * tau * fs), real=True)  # it must not come in again
        f = scipy.fft.rfftfreq(n, 1 / fs)
        smooth = np.exp(-((f / (2 * f_max)) ** 4) + 2j * np.pi * f * (float(time[0]) - instant))
        spectrum = fs * tau * glitches.SHAPES[shape](np.asarray(2j * np.pi * f * tau)) * smooth
        column[:] = scipy.fft.irfft(spectrum, n)[: time.size]
    return values


def find_glitches(
    series: Array, valid: NDArray[np.bool_], time: Array, band: tuple[float, float]
) -> tuple[glitches.Glitch, ...] | None:
    """Return the glitches in the first column of a run.

    Parameters
    ----------
    series : ndarray, shape (N, K)
        What is searched; then what may explain it, each with a free coefficient.
    valid : ndarray of bool, shape (N,)
        Whether a sample counts.
    time : ndarray, shape (N,)
        Evenly spaced [s].
    band : tuple of float
        Hz.

    Returns
    -------
    tuple of glitches.Glitch or None
        None where there is too much to be glitches.
    """
    fs = 1 / float(time[1] - time[0])
    factor = max(1, floor(fs / (RATE * band[1])))
    n = len(series) // factor
    means = series[: n * factor].reshape(n, factor, -1).mean(axis=1)
    whole = np.asarray(np.all(valid[: n * factor].reshape(n, factor), axis=1))
    instants, fs = time[: n * factor].reshape(n, factor).mean(axis=1), fs / factor
    long_glitches: list[glitches.Glitch] = []
    model: NoiseModel | None = None
    while len(long_glitches) <= max(1.0, MAX_PER_DAY * n / fs / 86400):
        shapes = columns(long_glitches, instants, fs, band[1])
        terms = windowing.transform(means, whole, fs, nuisance=[shapes] if long_glitches else ())
        model = _model(terms.band(*band), model)
        terms = terms.band(terms.f[0], band[1])
        S = model.expected(np.maximum(terms.f, band[0])) if model else 1 + (1e-3 / terms.f) ** 2
        S = np.where(terms.f < band[0], BURIED * S, S)
        U = whitened_run.whiten(terms, S)[0]
        peaks = glitches.strongest_peaks(terms, U @ lstsq_coefficients(U), S, fs)
        if not peaks:
            return tuple(long_glitches)
        long_glitches.append(peaks[0]._replace(time=float(instants[0]) + peaks[0].time))
    return None


def _model(terms: Spectra, previous: NoiseModel | None) -> NoiseModel | None:
    """Fit the PSD of the residual, weighted by the previous one."""
    S = previous.expected(terms.f) if previous else np.asarray(1 + (1e-3 / terms.f) ** 2)
    U, dof = whitened_run.whiten(terms, S)
    with suppress(FitError):  # where glitches spoil the residual that much, the PSD before has to do
        return fit_noise(terms.f, np.abs(U @ lstsq_coefficients(U)) ** 2 * S / 2, np.maximum(dof, 0))
    return previous


def glitch_warning(run: str, found: Sequence[glitches.Glitch] | None, duration: float) -> Finding | None:
    """Return what was subtracted from a run that lasts so many seconds, None where there was nothing."""
    if found is None:
        return Finding("glitches", "more exceeds the noise than glitches would; none is subtracted", run)
    spans = glitches.merge_spans([(max(a, 0.0), min(b, duration)) for a, b in (g.span for g in found)])
    if not spans:
        return None
    message = glitches.describe_spans(spans, "fitted and subtracted")
    return Finding("glitches", message, run, spans=tuple(spans))
