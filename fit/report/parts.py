"""Sections of the page: what the rooms of the report fill, and the template shows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fit.figures import Drawing
from fit.results import Fit, Results
from fit.tables import Grid
from fit.tables import parameters as tables
from fit.telemetry import Telemetry


@dataclass(frozen=True)
class Part:
    """A section of the page: words, tables, figures beside or `below` them, correlations of a fit to unfold.

    Over a `table` of parameters the text is what describes it.
    """

    anchor: str
    title: str
    text: str = ""
    grids: tuple[Grid, ...] = ()
    drawings: tuple[Drawing, ...] = ()
    below: bool = False
    correlation: Fit | None = None
    table: tables.Table | None = None


def fitted_for(
    name: str, results: Results, telemetries: Sequence[Telemetry]
) -> Iterator[tuple[Telemetry, Fit]]:
    """Yield every sysid run whose experiment, fitted alone, determines a parameter, and that fit."""
    for run in telemetries:
        fit = results.experiments.get(run.experiment)
        if run.kind == "sysid" and fit and name in fit.parameters:
            yield run, fit
