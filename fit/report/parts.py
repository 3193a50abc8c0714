"""Sections of the page: what the rooms of the report fill, and the template shows."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC

import numpy as np
from markupsafe import Markup

from fit.figures import Figure
from fit.results import Fit, Results
from fit.tables import Grid
from fit.tables import parameters as tables
from fit.telemetry import Telemetry, utc


@dataclass(frozen=True)
class Drawing:
    """A figure of the report, not yet drawn.

    Attributes
    ----------
    name : str
        Of its files, unique in the report.
    description, caption : str
        What it shows in plain words, for those who cannot see it; and what stands below.
    draw : callable
        Returns it, or an image that is there already.
    """

    name: str
    description: str
    caption: str
    draw: Callable[[], Figure | Markup]


@dataclass(frozen=True)
class Shown:
    """A figure in the page: the element, what to see in it, the name of its files."""

    element: Markup
    caption: str
    name: str


@dataclass(frozen=True)
class Part:
    """A section of the page: words, tables, and figures at their side, or below if `is_stacked`.

    Over a `table` of parameters the text is what describes it.
    """

    anchor: str
    title: str
    text: str = ""
    grids: tuple[Grid, ...] = ()
    drawings: tuple[Drawing | Shown, ...] = ()
    is_stacked: bool = False
    table: tables.Table | None = None


def fitted_for(
    name: str, results: Results, telemetries: Sequence[Telemetry]
) -> Iterator[tuple[Telemetry, Fit]]:
    """Yield every sysid run whose experiment, fitted alone, determines a parameter, and that fit."""
    for run in telemetries:
        fit = results.experiments.get(run.experiment)
        if run.kind == "sysid" and fit and name in fit.parameters:
            yield run, fit


def started(run: Telemetry) -> np.datetime64:
    """Return when a run began, UTC."""
    return np.datetime64(utc(run.t0).astimezone(UTC).replace(tzinfo=None))
