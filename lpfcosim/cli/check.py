"""The command ``check``: what to expect of a campaign before it is run."""

from pathlib import Path

from fit.parallel import processors
from lpfcosim.cli.console import Console
from lpfcosim.workflows import check as workflow


def check(campaign: Path, console: Console) -> None:
    """Validate a campaign and print what to expect of it, before anything is simulated."""
    with console.stage("forecast"):
        expected = workflow.check(campaign)
    console.print_json(expected.to_json())
    console.print_line(f"{campaign}: {expected.headline()}\n")
    for warning in expected.warnings:
        console.warn(warning)
    parts = (expected, expected.margins, expected.forecast)
    for table in (*(part.table() for part in parts if part is not None), expected.ttl_table()):
        if table is not None:
            console.print_table(table)
            console.print_line("")
    console.print_constraints(expected.constraints)
    if expected.wall_time is not None:
        n = processors()
        idle = f"{n} idle processors" if n > 1 else "an idle processor"
        console.print_line(f"run: about {_rounded(expected.wall_time)} on {idle}, once the FMUs are built")


def _rounded(seconds: float) -> str:
    """Return a time that is not known well as text."""
    if seconds < 90:
        return f"{seconds if seconds < 20 else 5 * round(seconds / 5):.0f} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
