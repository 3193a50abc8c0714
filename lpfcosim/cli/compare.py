"""The command ``compare``: results side by side."""

from collections.abc import Sequence
from pathlib import Path

from fit.comparison import compare
from lpfcosim.cli.console import Console


def compare_results(paths: Sequence[Path], console: Console) -> None:
    """Print the estimates of results and their differences from the first.

    Raises
    ------
    InputError
        If there are fewer than two, or one cannot be read.
    """
    with console.stage("reading"):
        comparison = compare(paths)
    for line in str(comparison).splitlines():
        console.print_line(line)
    console.print_json(comparison.to_json())
