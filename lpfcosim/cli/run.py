"""The command ``run``: simulate, fit, report."""

from pathlib import Path

from lpfcosim.cli.console import Console
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
    console.show_calibration(
        workflow.run(
            campaign,
            directory,
            jobs=jobs,
            scheduler=scheduler,
            time_limit=time_limit,
            rerun=rerun,
            trusted=trusted,
            progress=console,
        )
    )
