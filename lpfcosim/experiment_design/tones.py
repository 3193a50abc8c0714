"""Tones as a campaign has them, and what each is there for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.experiment_design.waveform import Chord, Voice
from lpfcosim.spacecraft import TaperedSine

Array = NDArray[np.float64]

LEAST = 0.02  # of the limits, that a tone has to take to be worth its line
TOLD = 1.01  # factor by which a sigma must grow without a tone for the tone to be there for it


@dataclass(frozen=True)
class Tone:
    """A tone and what it is for.

    Attributes
    ----------
    injection : TaperedSine
        The tone.
    without : mapping of str to float
        By parameter, how many times as large its sigma would be without the tone; the largest first.
    """

    injection: TaperedSine
    without: Mapping[str, float]

    @property
    def reason(self) -> str:
        """What it is for, in words."""
        grown = [f"{name} x{factor:.3g}" for name, factor in self.without.items()]
        return f"without it {', '.join(grown)}" if grown else "keeps the peaks low"


def injections(voice: Voice) -> tuple[TaperedSine, ...]:
    """Return the tones of an experiment, those left out that hardly count."""
    return tuple(_injection(voice, k, loop) for k, loop in _places(voice))


def _places(voice: Voice) -> list[tuple[int, int]]:
    scaled = np.abs(voice.amplitudes) / Chord(voice).units
    return [(int(k), int(loop)) for k, loop in np.argwhere(voice.used & (scaled > LEAST))]


def _injection(voice: Voice, k: int, loop: int) -> TaperedSine:
    stage, span = voice.stage, voice.span
    amplitude, number = complex(voice.amplitudes[k, loop]), int(voice.number[k])
    frequency = number / span.length
    return TaperedSine(
        into=stage.target(stage.loops[loop], frequency),
        amplitude=abs(amplitude),
        frequency=frequency,
        cycles=number,
        start=span.start,
        phase=float((np.angle(amplitude) + np.pi / 2) % (2 * np.pi)),
        ramp=span.ramp,
    )


def of(voice: Voice, information: Array, wanted: Sequence[int], names: Sequence[str]) -> tuple[Tone, ...]:
    """Return the tones of an experiment by frequency, those left out that hardly count.

    Parameters
    ----------
    voice : Voice
        The experiment.
    information : ndarray, shape (P, P)
        Of all experiments, scaled.
    wanted : sequence of int
        Which parameters count.
    names : sequence of str
        Of the P parameters.
    """
    chord = Chord(voice)
    scaled = voice.amplitudes / chord.units
    before = np.diag(np.linalg.inv(information))
    found = []
    for k, loop in _places(voice):
        rest = scaled[k].copy()
        rest[loop] = 0
        u, v = np.zeros_like(scaled), np.zeros_like(scaled)
        u[k], v[k] = scaled[k], rest
        lost = chord.information(u)[0] - chord.information(v)[0]
        ratio = np.sqrt(np.abs(np.diag(np.linalg.inv(information - lost))) / before)
        order = sorted(wanted, key=lambda i: -ratio[i])[:3]
        without = {names[i]: float(ratio[i]) for i in order if ratio[i] > TOLD}
        found.append(Tone(_injection(voice, k, loop), without))
    return tuple(found)
