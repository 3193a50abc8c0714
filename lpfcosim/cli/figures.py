"""Figures for print of the results in a folder."""

import re
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path

from fit.crosstalk import refit
from fit.figures import Chart
from fit.files import closest_match
from fit.report import page
from fit.results import load
from fit.results import results_folder as results_folder_of
from lpfcosim.cli.console import Console
from lpfcosim.cosim import SimulationProgress
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import Tasks, Workers, results_folder

WORDS = (
    *("responses", "spectra", "breakdown", "residual", "inertial", "stiffness", "gain"),
    *("noise", "over", "bode"),
)
_WORD = re.compile("[A-Za-z]{3,}")  # shorter ones are beginnings of names


def write_figures(directory: Path, names: Sequence[str], console: Console, *, jobs: int | None) -> int:
    """Draw the figures whose names contain one of `names`, or all of them; return their number."""
    results_folder.check_folder(directory, "figures", option="")
    if names:
        check_names(names, load(results_folder_of(directory) / "results.json").experiments, str(directory))
    with console.stage("reading"):
        results, telemetries = refit.load(directory)
    place = directory / "figures"
    with console.stage("preparation"):
        known = {spec.name: spec for spec in page.figure_specs(results, telemetries, directory)}
    for name in names:
        if not any(name in figure for figure in known):
            raise InputError(
                f"{directory}: no figure is called {name!r}, expected a part of {_list_names(known)}"
            )
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


def check_names(names: Iterable[str], experiments: Iterable[str], place: str) -> None:
    """Refuse parts of names of figures with a word that no figure has, before anything is read.

    Parameters
    ----------
    names : iterable of str
        Parts of names.
    experiments : iterable of str
        Experiments, which are parts of names as well.
    place : str
        Of the results, for messages.

    Raises
    ------
    InputError
        If there is one.
    """
    slugs = [slug for experiment in experiments for slug in _WORD.findall(experiment)]
    for name in names:
        for word in _WORD.findall(name):
            if not any(word in known for known in (*WORDS, *slugs)):
                raise InputError(f"{place}: no figure is called {name!r}{closest_match(word, WORDS)}")


def _list_names(names: Iterable[str]) -> str:
    return ", ".join(names) or "none, as there is nothing to draw"


# In a process of its own -------------------------------------------------------------------------------


def _draw(item: tuple[Path, str, Chart], _progress: SimulationProgress) -> None:
    from fit.plotting import draw, write  # takes its time

    place, name, figure = item
    write(place, name, draw, figure)
