"""The information of one tone about each parameter, by frequency."""

import numpy as np
from numpy.typing import NDArray

from lpfcosim.experiment_design.search import Design

Array = NDArray[np.float64]


def information_spectrum(design: Design, frequency: Array) -> dict[str, Array]:
    """Return the information of one tone at its limits on rms, in units of the inverse squared target sigma.

    That is for the best experiment and loop, all other parameters being known: at one, the tone alone would
    reach the target sigma.

    Parameters
    ----------
    design : Design
        The design.
    frequency : ndarray, shape (n,)
        Hz.
    """
    largest = np.zeros((len(design.problem.names), frequency.size))
    for experiment in design.problem.experiments:
        sensitivity, cost = experiment.responses(frequency)
        power = 1 / np.max(np.abs(cost) ** 2, axis=1)  # mean square, by frequency and loop
        information = 2 * experiment.model.duration * np.abs(sensitivity) ** 2 * power[:, None]
        largest = np.maximum(largest, information.max(axis=2).T)
    parameters = zip(design.problem.objective.indices, design.problem.parameters, strict=True)
    return {name: largest[i] for i, name in parameters}
