"""Limits of a design: peak, rms and slew of motions, forces and thrust, run by run."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.linear import response
from lpfcosim.spacecraft import Run, Sine

Array = NDArray[np.float64]

#: Quantities that are limited: the channel of the loop that each is made of, and its unit.
QUANTITIES: Mapping[str, tuple[str, str]] = {
    "o_1": ("o_1", "m"),
    "o_12": ("o_12", "m"),
    "F_x_1": ("f_x_1", "N"),
    "F_x_2": ("f_x_2", "N"),
    "F_x_sc": ("F_x_sc", "N"),
}
KINDS = ("peak", "rms", "slew", "authority")
NOTHING = {"m": 1e-13, "N": 1e-16}  # up to which nothing is meant: less than the noise of a second


@dataclass(frozen=True)
class Limit:
    """A limit of one run.

    Attributes
    ----------
    quantity : str
        One of the `QUANTITIES`.
    kind : str
        One of the `KINDS`: largest magnitude, root mean square over the run, largest change per second, and
        largest magnitude where no more can be commanded.
    value : float
        What it must not exceed, SI.
    """

    quantity: str
    kind: str
    value: float

    @property
    def is_zero(self) -> bool:
        """Whether it is practically zero: its loop cannot be driven."""
        return self.value <= NOTHING[QUANTITIES[self.quantity][1]]

    @property
    def is_peak_limit(self) -> bool:
        """Whether it depends on the phases of tones; only by mistake does anything reach an authority."""
        return self.kind in ("peak", "slew")

    @property
    def name(self) -> str:
        """Kind and quantity, such as ``peak of o_1``."""
        return f"{self.kind} of {self.quantity}"


def quantities(run: Run, channels: Mapping[str, Array]) -> dict[str, Array]:
    """Return the `QUANTITIES` from channels of a run."""
    per_mass = {"f_x_1", "f_x_2"}
    return {
        name: channels[channel] * (run.m_tm if channel in per_mass else 1.0)
        for name, (channel, _) in QUANTITIES.items()
        if channel in channels
    }


def tones(run: Run) -> Run:
    """Return a run with its tones alone injected: what a design replaces."""
    return replace(run, injections=tuple(i for i in run.injections if isinstance(i, Sine)))


def tone_response(run: Run) -> dict[str, Array]:
    """Return what the tones of a run make of the `QUANTITIES`, at its full rate and without noise."""
    return quantities(run, response.linear_response(tones(run), rate=run.fs))


def magnitudes(run: Run, signals: Mapping[str, Array], kind: str) -> dict[str, float]:
    """Return the magnitude of signals by name; `kind` is one of the `KINDS`."""

    def measure(x: Array) -> float:
        if kind == "rms":
            return float(np.sqrt(np.mean(x**2)))
        return float(np.max(np.abs(np.diff(x) * run.fs if kind == "slew" else x)))

    return {name: measure(x) for name, x in signals.items()}


def baseline_limits(run: Run, pairs: Collection[tuple[str, str]]) -> tuple[Limit, ...]:
    """Return what the tones of a run reach themselves, of each pair of quantity and kind in `pairs`."""
    signals = tone_response(run)
    values = {kind: magnitudes(run, signals, kind) for _, kind in pairs}
    return tuple(Limit(name, kind, values[kind][name]) for name, kind in pairs if name in signals)


def static_levels(run: Run) -> dict[str, float]:
    """Return the peaks of quantities without tones: static levels, and other injections."""
    injections = tuple(i for i in run.injections if not isinstance(i, Sine))
    signals = quantities(run, response.linear_response(replace(run, injections=injections)))
    static = {"F_x_2": abs(run.dc / run.truth["lambda_2"]) * run.m_tm}
    return {name: float(np.max(np.abs(x))) + static.get(name, 0.0) for name, x in signals.items()}


def limit_ratios(run: Run, limits: Iterable[Limit], signals: Mapping[str, Array]) -> dict[str, float]:
    """Return the magnitudes of signals in units of each limit, by the name of the limit."""
    active = [limit for limit in limits if not limit.is_zero]
    values = {kind: magnitudes(run, signals, kind) for kind in {limit.kind for limit in active}}
    return {limit.name: values[limit.kind][limit.quantity] / limit.value for limit in active}
