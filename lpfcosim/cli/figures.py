"""The command ``figures``: figures for print of the results in a folder."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path

from fit.crosstalk import refit
from fit.figures import Figure
from fit.report import page
from lpfcosim.cli.console import Console
from lpfcosim.cosim import SimulationProgress
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import Executor, WorkerConfig, results_folder
from lpfcosim.workflows import output_paths


def figures(directory: Path, names: Sequence[str], console: Console, *, jobs: int | None) -> None:
    """Draw the figures whose names contain one of `names`, all of them without any, on several processes."""
    output_paths.check_folder(directory, "figures", option="")
    with console.stage("reading"):
        results, telemetries = refit.load(directory)
    place = directory / "figures"
    with console.stage("preparation"):
        known = {spec.name: spec for spec in page.figure_specs(results, telemetries)}
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
        config = WorkerConfig(_draw, directory, directory / "logs", "figure '{}'")
        with (
            console.counted("figures", len(items)) as progress,
            closing(Executor(jobs).results(config, items, {})) as drawn,
        ):
            for done, (_, outcome) in enumerate(drawn, start=1):
                if isinstance(outcome, InputError | RunError):
                    raise outcome
                progress(done)
    console.print_line(f"{len(chosen)} figures: {place}")


def _list_names(names: Iterable[str]) -> str:
    return ", ".join(names) or "none, as there is nothing to draw"


# In a process of its own -------------------------------------------------------------------------------


def _draw(item: tuple[Path, str, Figure], _fmus: Mapping[str, Path], progress: SimulationProgress) -> None:
    progress.set_idle()  # nothing that hangs
    from fit.plotting import draw, write  # takes its time

    place, name, figure = item
    write(place, name, draw, figure)
