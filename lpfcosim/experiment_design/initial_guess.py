"""Initial tones of a search, which prunes them.

Where peaks are limited, they are all harmonics of one slow tone. Only such tones keep their phases to each
other, and make waves that are flatter than a sine. Where rms alone is limited, phases are free, and the tones
are those of the convex programme.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.experiment_design.convex_bound import Bands, Optimum
from lpfcosim.experiment_design.designed_experiment import HIGHEST, LOWEST, DesignedExperiment
from lpfcosim.experiment_design.multisine import Multisine, MultisineModel, ToneWindow

Array = NDArray[np.float64]

SLOWEST = (0.75e-3, 0.9e-3, 0.6e-3, 0.5e-3)  # Hz, the slow tones that are tried in turn
SPREAD = 24  # frequencies beside those of the programme
FAINTER = 0.01  # of a limit: size of tones that join those there are
FAINT = 0.02  # of the largest tone: size of those that the programme does without


def initial_tones(
    experiments: Sequence[DesignedExperiment],
    windows: Sequence[ToneWindow],
    optimum: Optimum,
    forbidden: Bands,
    spacing: float,
    n_trial: int,
    generator: np.random.Generator,
) -> tuple[Multisine, ...]:
    """Return many tones, as large as the programme has them, with drawn phases.

    Parameters
    ----------
    experiments : sequence of DesignedExperiment
        The experiments.
    windows : sequence of ToneWindow
        When the tones of each are on.
    optimum : Optimum
        The best power.
    forbidden : sequence of tuple of float
        Bands without tones [Hz].
    spacing : float
        Least distance of two tones [Hz].
    n_trial : int
        Which of the slow tones is tried, counted from zero.
    generator : Generator
        Of the phases.
    """
    multisines = []
    for n, (experiment, window) in enumerate(zip(experiments, windows, strict=True)):
        f = optimum.frequencies[n]
        cost = np.abs(experiment.responses(f)[1]) ** 2
        share = np.sqrt(np.einsum("nyl,nll->nl", cost, optimum.powers[n].real).max(axis=1))
        if not any(limit.is_peak_limit for limit in experiment.active_limits):
            candidates = np.concatenate(
                [f[share > 0.1 * share.max()], experiment.frequencies(SPREAD, forbidden)]
            )
        else:
            candidates = _harmonics(experiment, window, max(SLOWEST[n_trial % len(SLOWEST)], spacing))
        number = _spaced_harmonics(candidates, experiment, window, forbidden, spacing)
        size = np.full(number.size, FAINT * share.max())
        nearest = np.argmin(np.abs(number[:, None] / window.length - f), axis=0)
        np.maximum.at(size, nearest, share)
        magnitude = np.sqrt(np.sum(np.abs(experiment.responses(number / window.length)[1]) ** 2, axis=1))
        phase = generator.uniform(0, 2 * np.pi, magnitude.shape)
        amplitudes = size[:, None] / magnitude * np.exp(1j * phase)
        used = np.ones(amplitudes.shape, dtype=bool)
        multisines.append(
            Multisine(experiment, window, number, used, amplitudes, np.ones(len(experiment.active_limits)))
        )
    return tuple(multisines)


def add_harmonics(multisine: Multisine, forbidden: Bands, generator: np.random.Generator) -> Multisine:
    """Return an experiment with all harmonics of its slow tone, those that it does without faint."""
    window, step = multisine.window, int(np.gcd.reduce(multisine.number))
    number = np.arange(step, int(HIGHEST * window.length) + 1, step)
    number = np.union1d(
        number[multisine.experiment.allowed(number / window.length, forbidden)], multisine.number
    )
    shape = (number.size, multisine.used.shape[1])
    harmonics = replace(
        multisine, number=number, used=np.ones(shape, dtype=bool), amplitudes=np.ones(shape, complex)
    )
    faint = FAINTER * MultisineModel(harmonics).units * np.exp(1j * generator.uniform(0, 2 * np.pi, shape))
    index = np.searchsorted(number, multisine.number)
    faint[index] = np.where(multisine.used, multisine.amplitudes, faint[index])
    return replace(harmonics, amplitudes=faint)


def _harmonics(experiment: DesignedExperiment, window: ToneWindow, slowest: float) -> Array:
    """Return the multiples of a slow tone that has whole cycles [Hz]."""
    cycles = int(np.ceil(window.length * max(slowest, LOWEST / experiment.model.duration)))
    return np.asarray(np.arange(cycles, int(HIGHEST * window.length) + 1, cycles) / window.length)


def _spaced_harmonics(
    frequencies: Array, experiment: DesignedExperiment, window: ToneWindow, forbidden: Bands, spacing: float
) -> NDArray[np.intp]:
    """Return cycles in a span near frequencies, the first ones first, none closer than the spacing."""
    min_step = max(1, int(np.ceil(spacing * window.length)))
    number = np.round(frequencies * window.length).astype(int)
    number = number[experiment.allowed(number / window.length, forbidden)]
    numbers: list[int] = []
    for k in number.tolist():
        if all(abs(k - neighbour) >= min_step for neighbour in numbers):
            numbers.append(k)
    return np.array(sorted(numbers), dtype=np.intp)
