"""The table [events] of a campaign file: what happens unasked."""

from itertools import pairwise
from typing import Annotated, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from fit.files import Table, problem
from lpfcosim.campaign.units import AccelerationNoise, Quantity
from lpfcosim.campaign.values import Number, Utc
from lpfcosim.signals import events
from lpfcosim.spacecraft import Events

_NONE = Events()
Fading = Annotated[float, Quantity("a time", "s", "1 h", "positive", smallest=1.0, largest=1e6)]
GapDuration = Annotated[
    float, Quantity("a time", "s", "60 s", "positive", smallest=0.1, largest=events.LONGEST_GAP)
]
Impulse = Annotated[float, Quantity("a velocity", "m s^-1", "10 pm s^-1", "positive", largest=1e-6)]
Share = Annotated[Number, Field(ge=0, le=1)]


class PlateauTable(Table):
    """White part of the noise of Delta g at a date; between two dates it is interpolated exponentially."""

    date: Utc
    level: Annotated[AccelerationNoise, Field(gt=0)]


class EventsTable(Table):
    """[events]: random events; without this table there are none.

    Glitches are stray accelerations of a test mass, exponential in rise and fall. In gaps all channels are
    missing. ``tail_scatter`` changes the 1/f part of the noise of Delta g from experiment to experiment,
    ``plateau`` its white part with the date.
    """

    glitches_per_day: Annotated[Number, Field(ge=0, le=1000)] = _NONE.glitches_per_day
    glitch_impulse: Impulse = _NONE.glitch_impulse
    glitch_spread: Annotated[Number, Field(ge=0, le=2)] = _NONE.glitch_spread
    glitch_shortest: Fading = _NONE.glitch_shortest
    glitch_longest: Fading = _NONE.glitch_longest
    glitch_two_sided: Share = _NONE.glitch_two_sided
    gap_duration: GapDuration = _NONE.gap_duration
    gaps_per_day: Annotated[Number, Field(ge=0, le=1000)] = _NONE.gaps_per_day
    tail_scatter: Annotated[Number, Field(ge=0, le=1)] = 0.0
    plateau: Annotated[list[PlateauTable], Field(min_length=2)] = []

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
        share = rate * info.data.get("gap_duration", 0.0) / events.DAY
        if share > events.MAX_GAP_FRACTION / 2:
            raise problem(
                f"{rate:g} gaps of {info.data['gap_duration']:g} s a day take {100 * share:.2g} % of a run, "
                f"expected {50 * events.MAX_GAP_FRACTION:.2g} % at most: telemetry may lack 1 %"
            )
        return rate

    @model_validator(mode="after")
    def _none_for_nothing(self) -> Self:
        for prefix, rate in (("glitch_", "glitches_per_day"), ("gap_", "gaps_per_day")):
            idle = [key for key in self.model_fields_set if key.startswith(prefix)]
            if idle and rate not in self.model_fields_set:
                raise problem(f"{min(idle)} does nothing without {rate}")
        return self

    @field_validator("plateau")
    @classmethod
    def _one_after_another(cls, entries: list[PlateauTable]) -> list[PlateauTable]:
        dates = [entry.date for entry in entries]
        if any(later <= sooner for sooner, later in pairwise(dates)):
            raise problem("expected dates that grow from entry to entry")
        return entries

    def record(self) -> Events:
        """Return what happens to every run."""
        return Events(**self.model_dump(exclude={"tail_scatter", "plateau"}))

    def levels(self) -> tuple[tuple[str, float], ...]:
        """Return the dates, ISO 8601, and the white part of the noise of Delta g at them."""
        return tuple((entry.date.isoformat(), entry.level) for entry in self.plateau)
