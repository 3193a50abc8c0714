"""The command ``identify``: parameters of the FMUs in the loop, estimated from telemetry."""

from collections.abc import Sequence
from pathlib import Path

from lpfcosim.cli.console import Console
from lpfcosim.cli.constraints import Constraints
from lpfcosim.workflows import identify as workflow
from lpfcosim.workflows import output_paths


def identify_files(
    campaign: Path,
    paths: Sequence[Path],
    out: Path | None,
    console: Console,
    *,
    trusted: bool,
    constraints: Constraints,
) -> None:
    """Estimate the parameters that a campaign seeks from telemetry, and report."""
    directory = out or Path(f"{campaign.stem}-identified" if paths else campaign.stem)
    output_paths.check_folder(directory, "telemetry")
    identification = workflow.identify(
        campaign,
        paths,
        directory,
        parameters=constraints.tables(),
        trusted=trusted,
        progress=console,
    )
    console.show_calibration(identification, f"identified: {identification.path}, ")
