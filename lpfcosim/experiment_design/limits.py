"""What a design must not exceed: peak, rms and slew of motions, forces and thrust, run by run."""

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
    def of_nothing(self) -> bool:
        """Whether it is on what nobody drives, and what other loops hardly move."""
        return self.value <= NOTHING[QUANTITIES[self.quantity][1]]

    @property
    def of_wave(self) -> bool:
        """Whether it depends on the phases of tones; only by mistake does anything reach an authority."""
        return self.kind in ("peak", "slew")

    @property
    def name(self) -> str:
        """What is limited, in words."""
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


def driven(run: Run) -> dict[str, Array]:
    """Return what the tones of a run make of the `QUANTITIES`, at its full rate and without noise."""
    return quantities(run, response.linear_response(tones(run), rate=run.fs))


def reached(run: Run, of: Mapping[str, Array], kind: str) -> dict[str, float]:
    """Return what quantities reach, by name; `kind` is one of the `KINDS`."""

    def measure(x: Array) -> float:
        if kind == "rms":
            return float(np.sqrt(np.mean(x**2)))
        return float(np.max(np.abs(np.diff(x) * run.fs if kind == "slew" else x)))

    return {name: measure(x) for name, x in of.items()}


def own(run: Run, held: Collection[tuple[str, str]]) -> tuple[Limit, ...]:
    """Return what the tones of a run reach themselves, of each pair of quantity and kind in `held`."""
    of = driven(run)
    found = {kind: reached(run, of, kind) for _, kind in held}
    return tuple(Limit(name, kind, found[kind][name]) for name, kind in held if name in of)


def resting(run: Run) -> dict[str, float]:
    """Return how large quantities are without tones: what is held steadily, and what is no tone."""
    others = tuple(i for i in run.injections if not isinstance(i, Sine))
    moved = quantities(run, response.linear_response(replace(run, injections=others)))
    held = {"F_x_2": abs(run.f_x_2_start) * run.m_tm}
    return {name: float(np.max(np.abs(x))) + held.get(name, 0.0) for name, x in moved.items()}


def excess(run: Run, limits: Iterable[Limit], of: Mapping[str, Array]) -> dict[str, float]:
    """Return how far quantities go, in units of each limit; by the name of the limit."""
    kept = [limit for limit in limits if not limit.of_nothing]
    found = {kind: reached(run, of, kind) for kind in {limit.kind for limit in kept}}
    return {limit.name: found[limit.kind][limit.quantity] / limit.value for limit in kept}
