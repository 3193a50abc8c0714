"""Injections: the shapes that there are, each with its keys and its samples."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, Strict, ValidationInfo, field_validator
from pydantic.dataclasses import dataclass

from fit.errors import quote
from fit.files import closest_match, problem
from lpfcosim.constants import READ_OUT_RANGE, H
from lpfcosim.quantities import FORCE, LENGTH, Angle, BelowNyquist, Quantity, Record, Time

Array = NDArray[np.float64]

_AMPLITUDES = {quantity.unit: quantity for quantity in (LENGTH, FORCE)}


def _target(into: str, info: ValidationInfo) -> str:
    if info.context is not None and into not in info.context.targets:
        raise problem(f"{quote(into)} is not known{closest_match(into, info.context.targets)}")
    return into


def _in_the_unit_of_its_target(raw: object, info: ValidationInfo) -> object:
    into = info.data.get("into")
    if info.context is None or into is None:  # a wrong target is the first problem
        return raw if info.context is None else 0.0
    unit = info.context.unit(into)
    quantity = _AMPLITUDES.get(unit) or Quantity("an amplitude", unit, f"1 {unit}", "positive")
    amplitude = quantity.to_si(raw)
    if unit == LENGTH.unit and amplitude >= READ_OUT_RANGE:
        raise problem(f"{quote(raw)} is beyond the reach of the interferometers, {READ_OUT_RANGE:g} m")
    return amplitude


Target = Annotated[
    str, Strict(), AfterValidator(_target), Field(description="a target", examples=["guidance_o_12"])
]
Amplitude = Annotated[float, BeforeValidator(_in_the_unit_of_its_target), Field(examples=["10 nm"])]


@dataclass(frozen=True)
class Sine(Record):
    """``cycles`` periods of amplitude sin(2 pi frequency (t - start) + phase); SI, phase in rad.

    With a ``ramp`` [s] it rises as a half cosine in its first, and falls likewise in its last ``ramp``.
    """

    into: Target
    amplitude: Amplitude
    frequency: BelowNyquist
    cycles: Annotated[int, Strict(), Field(gt=0, le=10**9, examples=[4])]
    start: Time
    phase: Angle = 0.0
    ramp: Time = 0.0
    shape: Literal["sine"] = "sine"

    @field_validator("ramp")
    @classmethod
    def _fits(cls, ramp: float, info: ValidationInfo) -> float:
        duration = info.data.get("cycles", 0) / info.data.get("frequency", 1.0)
        if duration and 2 * ramp > duration * (1 + 1e-9):
            raise problem(f"{ramp:g} s twice is more than the sine lasts, {duration:.6g} s")
        return ramp

    @property
    def end(self) -> float:
        """Time the injection ends [s]."""
        return self.start + self.cycles / self.frequency

    def samples(self, since: Array) -> Array:
        """Return its values at times since its start [s], until its end."""
        sine = self.amplitude * np.sin(2 * np.pi * self.frequency * since + self.phase)
        if not self.ramp:
            return np.asarray(sine)
        margin = np.minimum(since, self.end - self.start - since)
        return np.asarray(sine * (0.5 - 0.5 * np.cos(np.pi * np.clip(margin / self.ramp, 0, 1))))


@dataclass(frozen=True)
class HalfCosine(Record):
    """A smooth step from 0 at ``start`` to ``amplitude`` at ``end``, kept from then on; SI."""

    into: Target
    amplitude: Amplitude
    start: Time
    end: Time
    shape: Literal["half_cosine"] = "half_cosine"

    @field_validator("end")
    @classmethod
    def _after_start(cls, end: float, info: ValidationInfo) -> float:
        if end < info.data.get("start", 0.0) + H:
            raise problem(f"{end:g} s is not after the start, {info.data['start']:g} s")
        return end

    def samples(self, since: Array) -> Array:
        """Return its values at times since its start [s], until its end."""
        ramp = 0.5 - 0.5 * np.cos(np.pi * since / (self.end - self.start))
        return np.asarray(self.amplitude * ramp)


Injection = Sine | HalfCosine
SHAPES = ("sine", "half_cosine")
