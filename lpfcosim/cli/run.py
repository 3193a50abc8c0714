"""The command ``run``: simulate, fit, report."""

from contextlib import nullcontext
from pathlib import Path

from lpfcosim.cli.console import Console
from lpfcosim.execution import dask_executor
from lpfcosim.workflows import output_paths
from lpfcosim.workflows import run as workflow


def run(
    campaign: Path,
    out: Path | None,
    console: Console,
    *,
    jobs: int | None,
    scheduler: str | None,
    time_limit: float | None,
    rerun: bool,
    trusted: bool,
) -> None:
    """Simulate a campaign, fit it, report."""
    directory = out or Path(campaign.stem)
    output_paths.check_folder(directory, "telemetry")
    with dask_executor(scheduler) if scheduler else nullcontext() as executor:
        calibration = workflow.run(
            campaign,
            directory,
            jobs=jobs,
            executor=executor,
            time_limit=time_limit,
            rerun=rerun,
            trusted=trusted,
            progress=console,
        )
    console.show_calibration(calibration)
