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
from fit.quality.glitches import FITTED_ALONG, describe_spans, merge_spans
from fit.quality.initial_fit import lstsq_coefficients
from fit.quality.matching_pursuit import matching_pursuit
from fit.quality.whitened_templates import WhitenedTemplates
from fit.spectra import NoiseModel, Spectra, fit_noise, windowing
from fit.warnings import FitWarning, TimeSpan
from fit.whitening import Glitch, glitch_templates, whitened_run

Array = NDArray[np.float64]

RATE = 25.0  # samples per cycle of the highest frequency of the band
MAX_ITERATIONS = 40
MAX_PER_DAY = 6.0  # shapes; beyond, it is no matter of glitches
BURIED = 1e12  # power that stands for bins below the band, without information


def find_glitches(
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
    glitches: list[Glitch] = []
    model: NoiseModel | None = None
    for _ in range(MAX_ITERATIONS):
        terms = windowing.transform(
            means, whole, fs, nuisance=glitch_templates.columns(glitches, instants, fs)
        )
        model = _model(terms.band(*band), model)
        candidates = matching_pursuit(_templates(terms, band, model, instants, fs, glitches))
        if not candidates:
            return tuple(glitches)
        glitches += [one.glitch for one in candidates]
        if len(glitches) > max(1.0, MAX_PER_DAY * n / fs / 86400):
            return None
    return tuple(glitches)


def _model(terms: Spectra, previous: NoiseModel | None) -> NoiseModel | None:
    """Fit the PSD of the residual, weighted by the previous one."""
    S = previous.expected(terms.f) if previous else np.asarray(1 + (1e-3 / terms.f) ** 2)
    U, dof = whitened_run.whiten(terms, S)
    with suppress(FitError):  # where glitches spoil the residual that much, the PSD before has to do
        return fit_noise(terms.f, np.abs(U @ lstsq_coefficients(U)) ** 2 * S / 2, np.maximum(dof, 0))
    return previous


def _templates(
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
    nuisance = whitened_run.as_real(np.hstack([terms.nuisance * np.sqrt(2 / S)[:, None], U[:, 1:]]))
    norms = np.linalg.norm(nuisance, axis=0)
    Q = np.linalg.qr(nuisance[:, norms > 0] / norms[norms > 0])[0]
    residual = whitened_run.as_real(U[:, 0])
    return WhitenedTemplates(
        time=time[: terms.window.size],
        fs=fs,
        f=f,
        S=S,
        window=terms.window,
        residual=residual - Q @ (Q.T @ residual),
        Q=Q,
        is_own_psd=True,
        known=tuple(known),
    )


def glitch_warning(run: str, glitches: Sequence[Glitch] | None, duration: float) -> FitWarning | None:
    """Return what was subtracted from a run that lasts so many seconds, None where there was nothing."""
    if glitches is None:
        message = "more exceeds the noise than glitches would; none is subtracted"
        return FitWarning("glitches", (), message)
    spans = merge_spans([(max(begin, 0.0), min(end, duration)) for begin, end in (g.span for g in glitches)])
    if not spans:
        return None
    message = describe_spans(spans, FITTED_ALONG)
    return FitWarning("glitches", (), message, spans=tuple(TimeSpan(run, *span) for span in spans))
