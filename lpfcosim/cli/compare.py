"""The command ``compare``: results side by side."""

from collections.abc import Sequence
from pathlib import Path

from fit import comparison
from lpfcosim.cli.console import Console


def compare(paths: Sequence[Path], console: Console) -> None:
    """Print the estimates of results and their differences from the first.

    Raises
    ------
    InputError
        If there are fewer than two, or one cannot be read.
    """
    with console.stage("reading"):
        found = comparison.compare(paths)
    for line in (*comparison.lines(found).aligned(), *comparison.sentences(found)):
        console.say(line)
    console.document(found.to_json())
