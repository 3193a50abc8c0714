"""A run as it would speak if one of its channels were late or early by whole samples."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.estimate import linear
from fit.estimate.consistency import Voice, voice
from fit.estimate.runs import Experiment
from fit.model import dynamics

Array = NDArray[np.float64]

SAMPLES = (1, -1, 2, -2)  # by which a channel may be late


def voices(experiment: Experiment, block: linear.Block, theta: Array) -> Iterator[tuple[str, Voice]]:
    """Yield in words which channel is late by how much, and what the run then says.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    block : linear.Block
        The sysid run as it was weighed.
    theta : ndarray, shape (P,)
        Where the voices of the others were taken.
    """
    run = experiment.sysid
    for name in dynamics.CHANNELS:
        if not np.any(getattr(run.channels, name)):
            continue
        for late in SAMPLES:
            shifted = run.earlier(name, late / run.telemetry.fs)
            terms = shifted.spectra(block.tau)
            if len(block.columns[0]) > len(terms.columns[0]):
                terms = terms.beside(shifted.wander(block.tau))
            if block.noise is None:
                return
            columns, _ = linear.whiten(terms, block.noise.expected(terms.f))
            when = "late" if late > 0 else "early"
            words = f"its {name} is {when} by {abs(late)} sample{'s' * (abs(late) > 1)}"
            of_run = replace(experiment, sysid=shifted)
            yield words, voice(of_run, replace(block, columns=columns), theta)
