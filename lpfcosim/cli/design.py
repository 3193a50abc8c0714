"""The command ``design``: the best injections within limits, as a campaign."""

from pathlib import Path

from lpfcosim.cli.console import Console
from lpfcosim.workflows import design as workflow


def design(campaign: Path, out: Path | None, console: Console, *, jobs: int | None) -> None:
    """Write a campaign with the best injections that are found."""
    designed = workflow.design(campaign, out, jobs=jobs, progress=console)
    console.print_json(designed.to_json())
    console.print_table(designed.table())
    console.print_line("")
    for line in designed.summary():
        console.print_line(line)
    designed.check_valid()
    console.print_line(f"{designed.path}: written; simulate it with: lpfcosim run {designed.path}")
