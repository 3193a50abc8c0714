"""Tones to begin a search with: many, from which it leaves out the least.

Where peaks are limited, they are all harmonics of one slow tone. Only such tones keep their phases to each
other, and make waves that are flatter than a sine. Where rms alone is limited, phases are free, and the tones
are those of the convex programme.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.experiment_design.programme import Bands, Optimum
from lpfcosim.experiment_design.stage import HIGHEST, LOWEST, Stage
from lpfcosim.experiment_design.waveform import Chord, Span, Voice

Array = NDArray[np.float64]

SLOWEST = (0.75e-3, 0.9e-3, 0.6e-3, 0.5e-3)  # Hz, the slow tones that are tried in turn
SPREAD = 24  # frequencies beside those of the programme
FAINTER = 0.01  # of a limit: size of tones that join those there are
FAINT = 0.02  # of the largest tone: size of those that the programme does without


def begun(
    stages: Sequence[Stage],
    spans: Sequence[Span],
    optimum: Optimum,
    forbidden: Bands,
    spacing: float,
    trial: int,
    generator: np.random.Generator,
) -> tuple[Voice, ...]:
    """Return many tones, as large as the programme has them, with drawn phases.

    Parameters
    ----------
    stages : sequence of Stage
        The experiments.
    spans : sequence of Span
        When the tones of each are on.
    optimum : Optimum
        The best power.
    forbidden : sequence of tuple of float
        Bands without tones [Hz].
    spacing : float
        Least distance of two tones [Hz].
    trial : int
        Which of the slow tones is tried, counted from zero.
    generator : Generator
        Of the phases.
    """
    voices = []
    for n, (stage, span) in enumerate(zip(stages, spans, strict=True)):
        f = optimum.frequencies[n]
        cost = np.abs(stage.responses(f)[1]) ** 2
        share = np.sqrt(np.einsum("nyl,nll->nl", cost, optimum.powers[n].real).max(axis=1))
        if not any(limit.of_wave for limit in stage.bounds):
            wanted = np.concatenate([f[share > 0.1 * share.max()], stage.frequencies(SPREAD, forbidden)])
        else:
            wanted = _harmonics(stage, span, max(SLOWEST[trial % len(SLOWEST)], spacing))
        number = _apart(wanted, stage, span, forbidden, spacing)
        size = np.full(number.size, FAINT * share.max())
        nearest = np.argmin(np.abs(number[:, None] / span.length - f), axis=0)
        np.maximum.at(size, nearest, share)
        each = np.sqrt(np.sum(np.abs(stage.responses(number / span.length)[1]) ** 2, axis=1))
        phase = generator.uniform(0, 2 * np.pi, each.shape)
        amplitudes = size[:, None] / each * np.exp(1j * phase)
        used = np.ones(amplitudes.shape, dtype=bool)
        voices.append(Voice(stage, span, number, used, amplitudes, np.ones(len(stage.bounds))))
    return tuple(voices)


def joined(voice: Voice, forbidden: Bands, generator: np.random.Generator) -> Voice:
    """Return an experiment with all harmonics of its slow tone, those that it does without faint."""
    span, step = voice.span, int(np.gcd.reduce(voice.number))
    number = np.arange(step, int(HIGHEST * span.length) + 1, step)
    number = np.union1d(number[voice.stage.allowed(number / span.length, forbidden)], voice.number)
    shape = (number.size, voice.used.shape[1])
    found = replace(voice, number=number, used=np.ones(shape, dtype=bool), amplitudes=np.ones(shape, complex))
    faint = FAINTER * Chord(found).units * np.exp(1j * generator.uniform(0, 2 * np.pi, shape))
    at = np.searchsorted(number, voice.number)
    faint[at] = np.where(voice.used, voice.amplitudes, faint[at])
    return replace(found, amplitudes=faint)


def _harmonics(stage: Stage, span: Span, slowest: float) -> Array:
    """Return the multiples of a slow tone that has whole cycles [Hz]."""
    cycles = int(np.ceil(span.length * max(slowest, LOWEST / stage.sight.duration)))
    return np.asarray(np.arange(cycles, int(HIGHEST * span.length) + 1, cycles) / span.length)


def _apart(wanted: Array, stage: Stage, span: Span, forbidden: Bands, spacing: float) -> NDArray[np.intp]:
    """Return cycles in a span near frequencies, the first ones first, none closer than the spacing."""
    least = max(1, int(np.ceil(spacing * span.length)))
    number = np.round(wanted * span.length).astype(int)
    number = number[stage.allowed(number / span.length, forbidden)]
    kept: list[int] = []
    for k in number.tolist():
        if all(abs(k - other) >= least for other in kept):
            kept.append(k)
    return np.array(sorted(kept), dtype=np.intp)
