"""Tones as injections of a campaign, and the parameters that need each of them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.experiment_design.design_problem import DesignProblem
from lpfcosim.experiment_design.multisine import Multisine
from lpfcosim.spacecraft import Sine

Array = NDArray[np.float64]

MIN_LIMIT_RATIO = 0.02  # of the limits, that a tone has to take to be worth its line
MIN_GROWTH = 1.01  # factor by which a sigma must grow without a tone for the tone to be there for it


@dataclass(frozen=True)
class Tone:
    """A tone and what it is for.

    Attributes
    ----------
    injection : Sine
        The tone.
    sigma_growth : mapping of str to float
        By parameter, how many times as large its sigma would be without the tone; the largest first.
    """

    injection: Sine
    sigma_growth: Mapping[str, float]

    @property
    def reason(self) -> str:
        """What it is for, in words."""
        grown = [f"{name} x{factor:.3g}" for name, factor in self.sigma_growth.items()]
        return f"without it {', '.join(grown)}" if grown else "keeps the peaks low"


def injections(multisine: Multisine) -> tuple[Sine, ...]:
    """Return the tones of an experiment, those left out that hardly count."""
    return tuple(_injection(multisine, k) for k in _significant(multisine))


def _significant(multisine: Multisine) -> list[int]:
    return np.flatnonzero(np.abs(multisine.amplitudes) > MIN_LIMIT_RATIO).tolist()


def _injection(multisine: Multisine, k: int) -> Sine:
    experiment, window = multisine.experiment, multisine.window
    amplitude = complex(multisine.amplitudes[k] * multisine.units[k])
    frequency = float(multisine.frequency[k])
    return Sine(
        into=experiment.target(experiment.loops[multisine.loop[k]], frequency),
        amplitude=abs(amplitude),
        frequency=frequency,
        cycles=int(multisine.number[k]),
        start=window.start,
        phase=float((np.angle(amplitude) + np.pi / 2) % (2 * np.pi)),
        ramp=window.ramp,
    )


def describe_tones(multisine: Multisine, information: Array, problem: DesignProblem) -> tuple[Tone, ...]:
    """Return the tones of an experiment by frequency, those left out that hardly count.

    Parameters
    ----------
    multisine : Multisine
        The experiment.
    information : ndarray, shape (P, P)
        Of all experiments, scaled.
    problem : DesignProblem
        Names the parameters that count.
    """
    whole = multisine.information(multisine.amplitudes)[0]
    variances = np.diag(np.linalg.inv(information))
    tones = []
    for k in _significant(multisine):
        rest = multisine.amplitudes.copy()
        rest[k] = 0
        remainder = information - whole + multisine.information(rest)[0]
        ratio = np.sqrt(np.diag(np.linalg.inv(remainder)) / variances)
        order = sorted(problem.objective.indices, key=lambda i: -ratio[i])[:3]
        growth = {problem.names[i]: float(ratio[i]) for i in order if ratio[i] > MIN_GROWTH}
        tones.append(Tone(_injection(multisine, k), growth))
    return tuple(tones)
