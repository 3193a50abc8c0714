"""The command ``check``: what to expect of a campaign before it is run."""

from pathlib import Path

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
    for table in expected.tables():
        console.print_table(table)
        console.print_line("")
    console.print_constraints(expected.constraints)
