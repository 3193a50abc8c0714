"""What one tone would tell of each parameter, frequency by frequency."""

import numpy as np
from numpy.typing import NDArray

from lpfcosim.experiment_design.search import Design

Array = NDArray[np.float64]


def telling(found: Design, frequency: Array) -> dict[str, Array]:
    """Return what one tone at its limits on rms would tell of each parameter, in units of what is wanted.

    It is the information in the best experiment and loop, all other parameters being known: at one, the tone
    alone would reach the sigma that is wanted.

    Parameters
    ----------
    found : Design
        The design.
    frequency : ndarray, shape (n,)
        Hz.
    """
    best = np.zeros((len(found.problem.names), frequency.size))
    for stage in found.problem.stages:
        told, cost = stage.responses(frequency)
        power = 1 / np.max(np.abs(cost) ** 2, axis=1)  # mean square, by frequency and loop
        alone = 2 * stage.sight.duration * np.abs(told) ** 2 * power[:, None]
        best = np.maximum(best, alone.max(axis=2).T)
    wanted = zip(found.problem.objective.wanted, found.problem.wanted, strict=True)
    return {name: best[i] for i, name in wanted}
