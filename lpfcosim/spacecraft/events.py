"""What happens to a run unasked: glitches, lost telemetry, noise that changes from run to run."""

from datetime import datetime
from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field, ValidationInfo, field_validator
from pydantic.dataclasses import dataclass

from fit.files import problem
from lpfcosim.quantities import AccelerationNoise, Number, Quantity, Record, Utc

DAY = 86400.0  # s
MAX_GAP_FRACTION = 0.0099  # share of a run that gaps may take; telemetry may lack 1 %
LONGEST_GAP = 597.0  # s; telemetry may lack 600 s at a time

Fading = Annotated[float, Quantity("a time", "s", "1 h", "positive", smallest=1.0, largest=1e6)]
GapDuration = Annotated[float, Quantity("a time", "s", "60 s", "positive", 0.1, LONGEST_GAP)]
Impulse = Annotated[float, Quantity("a velocity", "m s^-1", "10 pm s^-1", "positive", largest=1e-6)]
PerDay = Annotated[Number, Field(ge=0, le=1000)]


@dataclass(frozen=True)
class Plateau(Record):
    """White part of the noise of Delta g at a date; between two dates it is interpolated exponentially."""

    date: Utc
    level: AccelerationNoise


@dataclass(frozen=True)
class Events(Record):
    """How often things happen and how large they are; SI. Nothing of it is known to a controller or a fit.

    Attributes
    ----------
    glitches_per_day : float
        Rate of stray accelerations of a test mass (in flight about one, arXiv 2205.11938).
    glitch_impulse : float
        Median of the velocity they give [m/s] (choice).
    glitch_spread : float
        Standard deviation of its decimal logarithm (choice).
    glitch_shortest, glitch_longest : float
        Between these the time in which they fade lies [s], evenly in the logarithm (choice; in flight
        seconds to hours).
    glitch_two_sided : float
        Share of those that take back the velocity they gave (choice).
    gap_duration : float
        Mean length of the losses of telemetry [s].
    gaps_per_day : float
        Their rate.
    tail_scatter : float
        Scatter of the logarithm of the 1/f noise of Delta g from experiment to experiment.
    plateau : tuple of Plateau
        The white part of the noise of Delta g by date.
    """

    glitches_per_day: PerDay = 0.0
    glitch_impulse: Impulse = 1e-11
    glitch_spread: Annotated[Number, Field(ge=0, le=2)] = 0.5
    glitch_shortest: Fading = 5.0
    glitch_longest: Fading = 7200.0
    glitch_two_sided: Annotated[Number, Field(ge=0, le=1)] = 0.3
    gap_duration: GapDuration = 60.0
    gaps_per_day: PerDay = 0.0
    tail_scatter: Annotated[Number, Field(ge=0, le=1)] = 0.0
    plateau: tuple[Plateau, ...] = ()

    @field_validator("glitch_longest")
    @classmethod
    def _in_order(cls, longest: float, info: ValidationInfo) -> float:
        shortest = info.data.get("glitch_shortest", 0.0)
        if longest < shortest:
            raise problem(f"{longest:g} s is below glitch_shortest, {shortest:g} s")
        return longest

    @field_validator("gaps_per_day")
    @classmethod
    def _within_what_is_read(cls, rate: float, info: ValidationInfo) -> float:
        share = rate * info.data.get("gap_duration", 0.0) / DAY
        if info.context is not None and share > MAX_GAP_FRACTION / 2:
            raise problem(
                f"{rate:g} gaps of {info.data['gap_duration']:g} s a day take {100 * share:.2g} % of a run, "
                f"expected {50 * MAX_GAP_FRACTION:.2g} % at most: telemetry may lack 1 %"
            )
        return rate

    @field_validator("plateau")
    @classmethod
    def _one_after_another(cls, entries: tuple[Plateau, ...]) -> tuple[Plateau, ...]:
        if any(later.date <= sooner.date for sooner, later in pairwise(entries)):
            raise problem("expected dates that grow from entry to entry")
        return entries

    def plateau_at(self, start: datetime) -> float:
        """Return the white part at a date; before the first date it is as there, after the last likewise."""
        dates = [entry.date.timestamp() for entry in self.plateau]
        logarithms = np.log([entry.level for entry in self.plateau])
        return float(np.exp(np.interp(start.timestamp(), dates, logarithms)))
