"""Figures of the noise of Delta g: spectra with the LISA requirement, levels against date and authority."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.figures.charts import (
    ASD,
    FREQUENCY,
    START,
    Axis,
    Chart,
    Curve,
    Limits,
    Mark,
    Panel,
    Points,
    Shape,
    limits,
    posix,
)
from fit.parameters import PLATEAU, lisa
from fit.spectra import Level, LogSpectrum

Array = NDArray[np.float64]

#: Where Brownian noise rules, and where forces of long periods do [Hz].
BANDS: Mapping[str, Limits] = {"1–10 mHz": (1e-3, 10e-3), "0.2–0.5 mHz": (0.2e-3, 0.5e-3)}
PLAIN, LOW = BANDS
_SHOWN = (5e-5, 1e-1)  # Hz
_ROLES = ("blue", "orange", "green", "violet")
_LEVEL = Axis("ASD", "fm s⁻²/√Hz", "asd [fm s-2 Hz-1/2]")
_AUTHORITY = Axis("effective authority", "pN", "effective authority [pN]")
_REQUIREMENT = "LISA, two test masses"


@dataclass(frozen=True)
class NoisePoint:
    """How loud Delta g is in a noise run.

    Attributes
    ----------
    name : str
        Of the run.
    start : numpy.datetime64
        UTC.
    authority : float
        `fit.parameters.effective_authority` of the run [N].
    levels : mapping of str to Level
        By name of the `BANDS` [m s^-2 Hz^-1/2].
    """

    name: str
    start: np.datetime64
    authority: float
    levels: Mapping[str, Level]

    @property
    def year(self) -> str:
        """In which it began."""
        return str(self.start)[:4]


def spectra(log_spectra: Mapping[str, LogSpectrum]) -> Chart:
    """Draw the spectra of Delta g of some runs, by name, with the LISA requirement."""
    marks = []
    for role, (name, s) in zip(_ROLES, log_spectra.items(), strict=False):
        inside = (s.f >= _SHOWN[0]) & (s.f <= _SHOWN[1] * 1.01)
        x, y, low, high = (x[inside] for x in (s.f, s.psd**0.5, s.low**0.5, s.high**0.5))
        marks.append(Curve(name=name, label=name, role=role, x=x, y=y, low=low, high=high))
    f = np.geomspace(*_SHOWN, 40)
    requirement = np.array([lisa(x) for x in f])
    marks.append(Curve(name=_REQUIREMENT, label=_REQUIREMENT, role="ink", x=f, y=requirement, dash="--"))
    return Chart((Panel(FREQUENCY, ASD, tuple(marks), _SHOWN, limits(ASD, marks, _SHOWN), 2.2),))


def by_date(points: Sequence[NoisePoint]) -> Chart:
    """Draw the levels against date, with those of the flight and the LISA requirement."""
    points = sorted(points, key=lambda p: p.start)
    when, flown = posix([p.start for p in points]), _flown()
    levels = {band: _points("noise runs", points, when, band) for band in BANDS}
    across = limits(START, [levels[PLAIN], flown], key="x")
    panels = []
    for band, mark in levels.items():
        x, level = np.array(across), np.full(2, 1e15 * required(BANDS[band]))
        requirement = Curve(name=_REQUIREMENT, label="LISA", role="ink", x=x, y=level, dash="--")
        panels.append(_panel(START, band, (requirement, *((flown,) if band == PLAIN else ()), mark), across))
    return Chart(tuple(panels))


def required(band: Limits) -> float:
    """Return the level of `fit.parameters.lisa` over a band, as `Estimator.level` finds it."""
    f = np.linspace(*band, 201)
    return float(np.sqrt(np.trapezoid([lisa(x) ** 2 for x in f], f) / (band[1] - band[0])))


def by_authority(points: Sequence[NoisePoint]) -> Chart:
    """Draw the levels against authority, with a mark for each year."""
    points = sorted(points, key=lambda p: p.authority)
    years = sorted({p.year for p in points})
    across = (0.0, 1.06e12 * max(p.authority for p in points))
    panels = []
    for band in BANDS:
        marks: list[Mark] = []
        for k, year in enumerate(years):
            members = [p for p in points if p.year == year]
            mark: Shape = "ring" if k % 2 else "dot"
            marks.append(_points(year, members, 1e12 * np.array([p.authority for p in members]), band, mark))
        panels.append(_panel(_AUTHORITY, band, marks, across))
    return Chart(tuple(panels))


def _flown() -> Points:
    asd, sigma = 1e15 * np.array([(flown.asd, flown.sigma) for flown in PLATEAU]).T
    days = [np.datetime64(flown.day) for flown in PLATEAU]
    return Points(
        name="flight", label="flight", role="orange", x=posix(days), y=asd, low=asd - sigma, high=asd + sigma,
        names=[str(day)[:7] for day in days], mark="square",
    )  # fmt: skip


def _points(label: str, points: Sequence[NoisePoint], x: Array, band: str, mark: Shape = "dot") -> Points:
    """Return the levels in a band as marks."""
    y, low, high = 1e15 * np.array([(v.asd, v.low, v.high) for v in (p.levels[band] for p in points)]).T
    names = [p.name for p in points]
    return Points(name=label, label=label, role="blue", x=x, y=y, low=low, high=high, names=names, mark=mark)


def _panel(x: Axis, band: str, marks: Sequence[Mark], across: Limits) -> Panel:
    up = (0.0, limits(_LEVEL, marks)[1])
    return Panel(x, _LEVEL, tuple(marks), across, up, 1.5, band)
