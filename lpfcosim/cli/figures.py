"""Figures for print of the results in a folder."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from fit.crosstalk import refit
from fit.figures import Chart
from fit.files import closest_match
from fit.report import page
from lpfcosim.cli.console import Console
from lpfcosim.cosim import SimulationProgress
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import Tasks, Workers, results_folder


def write_figures(directory: Path, names: Sequence[str], console: Console, *, jobs: int | None) -> int:
    """Draw the figures whose names contain one of `names`, or all of them; return their number."""
    results_folder.check_folder(directory)
    with console.stage("reading"):
        results, telemetries = refit.load(directory)
    place = directory / "figures"
    with console.stage("preparation"):
        known = {spec.name: spec for spec in page.figure_specs(results, telemetries)}
    for name in names:
        if not any(name in figure for figure in known):
            raise InputError(f"{directory}: no figure is called {name!r}{closest_match(name, known)}")
    chosen = [name for name in known if not names or any(part in name for part in names)]
    with results_folder.lock(directory):
        place.mkdir(exist_ok=True)
        with console.counted("spectra", len(chosen)) as progress:
            items = {}
            for name in chosen:
                items[name] = (place, name, known.pop(name).draw())
                progress(len(items))
        tasks = Tasks(_draw, items, directory, directory / "logs", "figure '{}'")
        with (
            console.counted("figures", len(items)) as progress,
            closing(Workers(jobs).results(tasks)) as drawn,
        ):
            for done, (_, outcome) in enumerate(drawn, start=1):
                if isinstance(outcome, InputError | RunError):
                    raise outcome
                progress(done)
    return len(chosen)


# In a process of its own -------------------------------------------------------------------------------


def _draw(item: tuple[Path, str, Chart], _progress: SimulationProgress) -> None:
    from fit.plotting import draw, write  # takes its time

    place, name, figure = item
    write(place, name, draw, figure)
