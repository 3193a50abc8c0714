"""Glitches in long noise runs, at the low frequencies of the inertial fit.

There a glitch of seconds is as good as an impulse, and nothing is masked: everything that stands out becomes
a shape with an amplitude (`fit.whitening.glitch_templates`). The search is a matching pursuit in the residual
of a run of few columns, averaged to the few samples that the band needs.
"""

from collections.abc import Sequence
from contextlib import suppress
from math import floor

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.quality.first_fit import least
from fit.quality.glitches import TAKEN_OUT, merged, placed
from fit.quality.matching_pursuit import matching_pursuit
from fit.quality.whitened_templates import WhitenedTemplates
from fit.spectra import NoiseModel, Spectra, fit_noise, windowing
from fit.warnings import FitWarning, TimeSpan
from fit.whitening import Glitch, glitch_templates, whitened_run

Array = NDArray[np.float64]

RATE = 25.0  # samples per cycle of the highest frequency of the band
ROUNDS = 40
MOST_PER_DAY = 6.0  # shapes; beyond, it is no matter of glitches
BURIED = 1e12  # power that stands for bins below the band, which tell nothing


def glitches(
    columns: Array, valid: NDArray[np.bool_], time: Array, band: tuple[float, float]
) -> tuple[Glitch, ...] | None:
    """Return the glitches in the first column of a run.

    Parameters
    ----------
    columns : ndarray, shape (N, K)
        What is searched; then what may explain it, each with a free coefficient.
    valid : ndarray of bool, shape (N,)
        Whether a sample counts.
    time : ndarray, shape (N,)
        Evenly spaced [s].
    band : tuple of float
        Hz.

    Returns
    -------
    tuple of Glitch or None
        None where there is too much to be glitches.
    """
    fs = 1 / float(time[1] - time[0])
    factor = max(1, floor(fs / (RATE * band[1])))
    n = len(columns) // factor
    means = columns[: n * factor].reshape(n, factor, -1).mean(axis=1)
    whole = np.asarray(np.all(valid[: n * factor].reshape(n, factor), axis=1))
    instants, fs = time[: n * factor].reshape(n, factor).mean(axis=1), fs / factor
    found: list[Glitch] = []
    model: NoiseModel | None = None
    for _ in range(ROUNDS):
        terms = windowing.transform(means, whole, fs, nuisance=glitch_templates.columns(found, instants, fs))
        model = _model(terms.band(*band), model)
        more = matching_pursuit(_view(terms, band, model, instants, fs, found))
        if not more:
            return tuple(found)
        found += [one.glitch for one in more]
        if len(found) > max(1.0, MOST_PER_DAY * n / fs / 86400):
            return None
    return tuple(found)


def _model(terms: Spectra, before: NoiseModel | None) -> NoiseModel | None:
    """Fit the PSD of the residual, weighed by the one before."""
    S = before.expected(terms.f) if before else np.asarray(1 + (1e-3 / terms.f) ** 2)
    U, left = whitened_run.whiten(terms, S)
    with suppress(FitError):  # where glitches spoil the residual that much, the PSD before has to do
        return fit_noise(terms.f, np.abs(U @ least(U)) ** 2 * S / 2, np.maximum(left, 0))
    return before


def _view(
    terms: Spectra,
    band: tuple[float, float],
    model: NoiseModel | None,
    time: Array,
    fs: float,
    known: Sequence[Glitch],
) -> WhitenedTemplates:
    """Return the run as the pursuit sees it: all bins from the first, those outside the band buried."""
    f = terms.f[terms.f <= band[1]]
    terms = terms.band(f[0], f[-1])
    S = model.expected(np.maximum(f, band[0])) if model else np.asarray(1 + (1e-3 / f) ** 2)
    S = np.where(f < band[0], BURIED * S, S)
    U, _ = whitened_run.whiten(terms, S)
    beside = whitened_run.stacked(np.hstack([terms.nuisance * np.sqrt(2 / S)[:, None], U[:, 1:]]))
    norms = np.linalg.norm(beside, axis=0)
    Q = np.linalg.qr(beside[:, norms > 0] / norms[norms > 0])[0]
    residual = whitened_run.stacked(U[:, 0])
    return WhitenedTemplates(
        time=time[: terms.window.size],
        fs=fs,
        f=f,
        S=S,
        window=terms.window,
        residual=residual - Q @ (Q.T @ residual),
        Q=Q,
        own=True,
        known=tuple(known),
    )


def told(run: str, found: Sequence[Glitch] | None, duration: float) -> FitWarning | None:
    """Say what was taken out of a run that lasts so many seconds, None where there was nothing."""
    if found is None:
        message = "more stands out of the noise than glitches would; none is taken out"
        return FitWarning("glitches", (), message)
    spans = merged([(max(begin, 0.0), min(end, duration)) for begin, end in (g.span for g in found)])
    if not spans:
        return None
    message = placed(spans, TAKEN_OUT)
    return FitWarning("glitches", (), message, spans=tuple(TimeSpan(run, *span) for span in spans))
