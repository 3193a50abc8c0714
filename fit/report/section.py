"""Sections of the page: what the modules of the report fill, and the template shows."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC

import numpy as np
from markupsafe import Markup

from fit.figures import Chart
from fit.report.parameter_table import ParameterTable
from fit.results import Fit, Results
from fit.tables import Table
from fit.telemetry import Telemetry, utc


@dataclass(frozen=True)
class FigureSpec:
    """A figure of the report, not yet drawn.

    Attributes
    ----------
    name : str
        Of its files, unique in the report.
    description, caption : str
        Alternative text, and text below the figure.
    draw : callable
        Returns it, or an image that is there already.
    """

    name: str
    description: str
    caption: str
    draw: Callable[[], Chart | Markup]


@dataclass(frozen=True)
class RenderedFigure:
    """A figure in the page: its element, its caption, the name of its files."""

    element: Markup
    caption: str
    name: str


@dataclass(frozen=True)
class Section:
    """A section of the page.

    Attributes
    ----------
    anchor, title : str
        Target of its link, and heading.
    text : str
        Of a `parameters` table, its description.
    facts : mapping of str to str
        Values in a few words each, by name.
    parameters : ParameterTable or None
        Estimates with truth, pull and flight value.
    tables : tuple of Table
        Other tables.
    figures : tuple of FigureSpec or RenderedFigure
        Figures below the tables.
    """

    anchor: str
    title: str
    text: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    parameters: ParameterTable | None = None
    tables: tuple[Table, ...] = ()
    figures: tuple[FigureSpec | RenderedFigure, ...] = ()


def single_fits(
    name: str, results: Results, telemetries: Sequence[Telemetry]
) -> Iterator[tuple[Telemetry, Fit]]:
    """Yield every sysid run whose single-experiment fit determines a parameter, and that fit."""
    for run in telemetries:
        fit = results.experiments.get(run.experiment)
        if run.kind == "sysid" and fit and name in fit.parameters:
            yield run, fit


def start_time(run: Telemetry) -> np.datetime64:
    """Return the start of a run, UTC."""
    return np.datetime64(utc(run.t0).astimezone(UTC).replace(tzinfo=None))


def start_text(run: Telemetry, form: str = "%Y-%m-%d %H:%M:%S") -> str:
    """Return the start of a run in print, UTC."""
    return utc(run.t0).astimezone(UTC).strftime(form)
