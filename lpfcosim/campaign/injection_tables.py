"""Injections of a campaign file: the shapes that there are, each with its keys."""

from typing import Annotated, Literal

from pydantic import Field, Strict, ValidationInfo, field_validator

from fit.errors import quote
from fit.files import Table, problem
from lpfcosim.campaign.declared_tables import spacecraft_of, unknown_name
from lpfcosim.campaign.units import FORCE, LENGTH, YEAR, Angle, Quantity, Time
from lpfcosim.campaign.values import BelowNyquist
from lpfcosim.spacecraft import READ_OUT_RANGE, H, HalfCosine, Sine, TaperedSine

SHAPES = ("sine", "tapered_sine", "half_cosine")
_AMPLITUDES = {quantity.unit: quantity for quantity in (LENGTH, FORCE)}
_TARGETS = "guidance_o_1, guidance_o_12, F_x_1 or F_x_2; of another spacecraft one of its targets"


class _InjectionTable(Table):
    into: Annotated[str, Strict(), Field(description=_TARGETS, examples=['into = "guidance_o_12"'])]
    amplitude: Annotated[float, Field(examples=['amplitude = "10 nm"'])]
    start: Time

    @field_validator("into")
    @classmethod
    def _is_target(cls, into: str, info: ValidationInfo) -> str:
        spacecraft = spacecraft_of(info)
        if into not in spacecraft.targets:
            raise problem(f"{quote(into)} is not known{unknown_name(into, spacecraft.targets, spacecraft)}")
        return into

    @field_validator("amplitude", mode="before")
    @classmethod
    def _in_the_unit_of_its_target(cls, raw: object, info: ValidationInfo) -> object:
        into = info.data.get("into")
        if into is None:
            return 0.0  # a wrong target is the first problem
        unit = spacecraft_of(info).unit(into)
        quantity = _AMPLITUDES.get(unit) or Quantity("an amplitude", unit, f"1 {unit}", "positive")
        amplitude = quantity.to_si(raw)
        if unit == LENGTH.unit and amplitude >= READ_OUT_RANGE:
            raise problem(f"{quote(raw)} is beyond the reach of the interferometers, {READ_OUT_RANGE:g} m")
        return amplitude


class SineTable(_InjectionTable):
    """A sine with an integer number of cycles."""

    shape: Literal["sine"]
    frequency: BelowNyquist
    cycles: Annotated[int, Strict(), Field(gt=0, le=10**9, examples=["cycles = 4"])]
    phase: Angle = 0.0

    def record(self) -> Sine:
        """Return the injection as the simulation knows it."""
        return Sine(**self.model_dump(exclude={"shape"}))


class TaperedSineTable(SineTable):
    """A sine with an integer number of cycles whose amplitude rises and falls over ``ramp`` at both ends."""

    shape: Literal["tapered_sine"]  # type: ignore[assignment]
    ramp: Annotated[float, Quantity("a time", "s", "300 s", "positive", largest=YEAR)]

    @field_validator("ramp")
    @classmethod
    def _check_ramp(cls, ramp: float, info: ValidationInfo) -> float:
        duration = info.data.get("cycles", 0) / info.data.get("frequency", 1.0)
        if duration and 2 * ramp > duration * (1 + 1e-9):
            raise problem(f"{ramp:g} s twice is more than the sine lasts, {duration:.6g} s")
        return ramp

    def record(self) -> TaperedSine:
        """Return the injection as the simulation knows it."""
        return TaperedSine(**self.model_dump(exclude={"shape"}))


class HalfCosineTable(_InjectionTable):
    """A smooth step from zero at ``start`` to ``amplitude`` at ``end``, kept until the run ends."""

    shape: Literal["half_cosine"]
    end: Time

    @field_validator("end")
    @classmethod
    def _after_start(cls, end: float, info: ValidationInfo) -> float:
        if end < info.data.get("start", 0.0) + H:
            raise problem(f"{end:g} s is not after the start, {info.data['start']:g} s")
        return end

    def record(self) -> HalfCosine:
        """Return the injection as the simulation knows it."""
        return HalfCosine(**self.model_dump(exclude={"shape"}))


InjectionTable = Annotated[SineTable | TaperedSineTable | HalfCosineTable, Field(discriminator="shape")]
