"""The command ``montecarlo``: many campaigns, each simulated and fitted anew."""

from contextlib import nullcontext
from pathlib import Path

from lpfcosim.cli.console import Console
from lpfcosim.execution import dask_executor
from lpfcosim.workflows import montecarlo as workflow
from lpfcosim.workflows import output_paths


def montecarlo(
    campaign: Path,
    n: int,
    out: Path | None,
    console: Console,
    *,
    redraw: bool,
    fmus: bool,
    trusted: bool,
    jobs: int | None,
    scheduler: str | None,
) -> None:
    """Repeat a campaign with new noise, fit each, report pulls and coverage."""
    directory = out or Path(f"{campaign.stem}-montecarlo")
    output_paths.check_folder(directory, "figures")
    with dask_executor(scheduler) if scheduler else nullcontext() as executor:
        study = workflow.montecarlo(
            campaign,
            n,
            directory,
            redraw=redraw,
            fmus=fmus,
            trusted=trusted,
            jobs=jobs,
            executor=executor,
            progress=console,
        )
    console.print_json(study.to_json())
    console.print_table(study.table())
    unfinished = f", {len(study.unfinished)} not done" if study.unfinished else ""
    console.print_line(f"{study.n} campaigns, {len(study.failures)} failed{unfinished}: {study.path}")
    if study.verdict.valid:
        parameters = f"{len(study)} parameter{'s' * (len(study) > 1)}"
        console.print_line(
            f"valid: pulls and coverage of {parameters} are consistent with valid uncertainties"
        )
    study.check_valid()
