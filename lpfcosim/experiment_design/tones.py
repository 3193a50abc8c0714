"""Tones as injections of a campaign, and the parameters that need each of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.experiment_design.multisine import Multisine, MultisineModel
from lpfcosim.spacecraft import TaperedSine

Array = NDArray[np.float64]

MIN_LIMIT_RATIO = 0.02  # of the limits, that a tone has to take to be worth its line
MIN_GROWTH = 1.01  # factor by which a sigma must grow without a tone for the tone to be there for it


@dataclass(frozen=True)
class Tone:
    """A tone and what it is for.

    Attributes
    ----------
    injection : TaperedSine
        The tone.
    sigma_growth : mapping of str to float
        By parameter, how many times as large its sigma would be without the tone; the largest first.
    """

    injection: TaperedSine
    sigma_growth: Mapping[str, float]

    @property
    def reason(self) -> str:
        """What it is for, in words."""
        grown = [f"{name} x{factor:.3g}" for name, factor in self.sigma_growth.items()]
        return f"without it {', '.join(grown)}" if grown else "keeps the peaks low"


def injections(multisine: Multisine) -> tuple[TaperedSine, ...]:
    """Return the tones of an experiment, those left out that hardly count."""
    return tuple(_injection(multisine, k, loop) for k, loop in _places(multisine))


def _places(multisine: Multisine) -> list[tuple[int, int]]:
    scaled = np.abs(multisine.amplitudes) / MultisineModel(multisine).units
    return [(int(k), int(loop)) for k, loop in np.argwhere(multisine.used & (scaled > MIN_LIMIT_RATIO))]


def _injection(multisine: Multisine, k: int, loop: int) -> TaperedSine:
    experiment, window = multisine.experiment, multisine.window
    amplitude, number = complex(multisine.amplitudes[k, loop]), int(multisine.number[k])
    frequency = number / window.length
    return TaperedSine(
        into=experiment.target(experiment.loops[loop], frequency),
        amplitude=abs(amplitude),
        frequency=frequency,
        cycles=number,
        start=window.start,
        phase=float((np.angle(amplitude) + np.pi / 2) % (2 * np.pi)),
        ramp=window.ramp,
    )


def describe_tones(
    multisine: Multisine, information: Array, indices: Sequence[int], names: Sequence[str]
) -> tuple[Tone, ...]:
    """Return the tones of an experiment by frequency, those left out that hardly count.

    Parameters
    ----------
    multisine : Multisine
        The experiment.
    information : ndarray, shape (P, P)
        Of all experiments, scaled.
    indices : sequence of int
        Which parameters count.
    names : sequence of str
        Of the P parameters.
    """
    model = MultisineModel(multisine)
    scaled = multisine.amplitudes / model.units
    sigmas_before = np.diag(np.linalg.inv(information))
    tones = []
    for k, loop in _places(multisine):
        rest = scaled[k].copy()
        rest[loop] = 0
        u, v = np.zeros_like(scaled), np.zeros_like(scaled)
        u[k], v[k] = scaled[k], rest
        contribution = model.information(u)[0] - model.information(v)[0]
        ratio = np.sqrt(np.abs(np.diag(np.linalg.inv(information - contribution))) / sigmas_before)
        order = sorted(indices, key=lambda i: -ratio[i])[:3]
        sigma_growth = {names[i]: float(ratio[i]) for i in order if ratio[i] > MIN_GROWTH}
        tones.append(Tone(_injection(multisine, k, loop), sigma_growth))
    return tuple(tones)
