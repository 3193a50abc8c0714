"""Bode diagram of control loops: responses of read-outs to their guidance, as modelled and as measured."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from fit.figures.charts import FREQUENCY, Axis, Chart, Curve, Mark, Panel, Points, Shape, Span, limits

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_MAGNITUDE = Axis("magnitude", "", "magnitude [1]", log=True)
_PHASE = Axis("phase", "deg", "phase [deg]")
_DIFFERENCE = Axis("measured − modelled", "σ", "difference [sigma]")
_ROLES = ("blue", "orange", "green", "violet", "rose", "cyan", "olive", "grey")
_WIDEST = 2.0  # sigma, of the band about the model
_ROOM = 3.0  # of the smallest magnitude measured, that is shown below it


@dataclass(frozen=True)
class LoopResponse:
    """Response of a read-out to its guidance.

    Attributes
    ----------
    read_out : str
        Name of the channel; `fit.telemetry.GUIDANCE` has that of the injections.
    frequency : ndarray, shape (N,)
        Of the model [Hz].
    modelled : ndarray of complex, shape (N,)
        Frequency response of the closed loop [1].
    tones : ndarray, shape (K,)
        Injected frequencies [Hz].
    names : tuple of str
        Experiment of each of the K tones.
    measured, expected : ndarray of complex, shape (K,)
        Response at the tones, estimated from telemetry and of the model [1].
    sigma : ndarray, shape (K,)
        Standard deviation of real and imaginary part of `measured` [1].
    """

    read_out: str
    frequency: Array
    modelled: Complex
    tones: Array
    names: tuple[str, ...]
    measured: Complex
    expected: Complex
    sigma: Array

    @property
    def differences(self) -> Array:
        """Differences of magnitude and phase from the model in sigma, shape (2, K)."""
        along = (self.measured / self.expected - 1) * np.abs(self.expected) / self.sigma
        return np.stack([along.real, along.imag])


def bode(loops: Sequence[LoopResponse]) -> Chart:
    """Draw magnitude and phase of control loops against frequency, and the differences of the measured ones.

    Parameters
    ----------
    loops : sequence of LoopResponse
        At least one, with a common range of frequencies.
    """
    across = (float(loops[0].frequency[0]), float(loops[0].frequency[-1]))
    magnitudes: list[Mark] = []
    phases: list[Mark] = []
    differences: list[Mark] = [Span(low=-_WIDEST, high=_WIDEST, role="grey", opacity=0.2, along="y")]
    for loop, role in zip(loops, cycle(_ROLES), strict=False):
        label = loop.read_out
        phase = np.unwrap(np.angle(loop.modelled))
        measured = np.interp(loop.tones, loop.frequency, phase) + np.angle(loop.measured / loop.expected)
        size = np.abs(loop.measured)
        magnitudes.append(_curve(loop, label, role, np.abs(loop.modelled)))
        magnitudes.append(_points(loop, "", role, size, loop.sigma))
        phases.append(_curve(loop, "", role, np.degrees(phase)))
        phases.append(_points(loop, "", role, np.degrees(measured), np.degrees(loop.sigma / size)))
        one = np.ones(loop.tones.size)
        of_magnitude, of_phase = loop.differences
        differences.append(_points(loop, f"{label} magnitude", role, of_magnitude, one))
        differences.append(_points(loop, f"{label} phase", role, of_phase, one, mark="ring"))
    highest = limits(_MAGNITUDE, magnitudes, across)[1]
    lowest = min(float(np.abs(loop.measured).min()) for loop in loops) / _ROOM
    largest = max(_WIDEST + 1, *map(abs, limits(_DIFFERENCE, differences)))
    return Chart(
        (
            Panel(
                FREQUENCY,
                _MAGNITUDE,
                tuple(magnitudes),
                across,
                (lowest, highest),
                1.4,
            ),
            Panel(FREQUENCY, _PHASE, tuple(phases), across, limits(_PHASE, phases, across), 1.2),
            Panel(FREQUENCY, _DIFFERENCE, tuple(differences), across, (-largest, largest), 1.2),
        )
    )


def _curve(loop: LoopResponse, label: str, role: str, y: Array) -> Curve:
    return Curve(name=f"{loop.read_out}, modelled", label=label, role=role, x=loop.frequency, y=y)


def _points(
    loop: LoopResponse, label: str, role: str, y: Array, sigma: Array, *, mark: Shape = "dot"
) -> Points:
    quantity = ("phase" if mark == "ring" else "magnitude") if label else "measured"
    return Points(
        name=f"{loop.read_out}, {quantity}",
        label=label,
        role=role,
        x=loop.tones,
        y=y,
        low=y - sigma,
        high=y + sigma,
        names=loop.names,
        mark=mark,
    )
