"""Bode diagram of control loops: responses of read-outs to their guidance, as modelled and as measured."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from fit.figures.charts import FREQUENCY, Axis, Chart, Curve, Mark, Panel, Points, Shape, Span, limits
from fit.figures.charts import measured as measured_points

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
    def at_tones(self) -> tuple[Array | Complex, ...]:
        """What there is for each tone."""
        return self.tones, self.measured, self.expected, self.sigma

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
        name, x = loop.read_out, loop.frequency
        phase, size = np.unwrap(np.angle(loop.modelled)), np.abs(loop.measured)
        measured = np.interp(loop.tones, x, phase) + np.angle(loop.measured / loop.expected)
        magnitudes += [
            Curve(name=f"{name}, modelled", label=name, role=role, x=x, y=np.abs(loop.modelled)),
            _points(loop, "measured", "", role, size, loop.sigma),
        ]
        phases += [
            Curve(name=f"{name}, modelled", label="", role=role, x=x, y=np.degrees(phase)),
            _points(loop, "measured", "", role, np.degrees(measured), np.degrees(loop.sigma / size)),
        ]
        for quantity, off in zip(("magnitude", "phase"), loop.differences, strict=True):
            differences.append(_points(loop, quantity, f"{name} {quantity}", role, off, np.ones(off.size)))
    lowest = min(float(np.abs(loop.measured).min()) for loop in loops) / _ROOM
    largest = max(_WIDEST + 1, *map(abs, limits(_DIFFERENCE, differences)))
    up = (lowest, limits(_MAGNITUDE, magnitudes, across)[1])
    return Chart(
        (
            Panel(FREQUENCY, _MAGNITUDE, tuple(magnitudes), across, up, 1.4),
            Panel(FREQUENCY, _PHASE, tuple(phases), across, limits(_PHASE, phases, across), 1.2),
            Panel(FREQUENCY, _DIFFERENCE, tuple(differences), across, (-largest, largest), 1.2),
        )
    )


def _points(loop: LoopResponse, quantity: str, label: str, role: str, y: Array, sigma: Array) -> Points:
    values = np.stack([y, sigma], axis=1)
    mark: Shape = "ring" if quantity == "phase" else "dot"
    points = measured_points(label, loop.tones, values, loop.names, mark=mark, role=role)
    return replace(points, name=f"{loop.read_out}, {quantity}")
