"""A figure of the report: written as files, and as an element of the page."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from fit.figures import files as figure_files


@dataclass(frozen=True)
class Drawing:
    """A figure of the page: an SVG element, what to see in it, and the name of its files in ``figures/``."""

    svg: Markup
    caption: str
    name: str


def drawing(
    folder: Path,
    name: str,
    description: str,
    caption: str,
    draw: Callable[..., figure_files.Plot],
    *arguments: object,
) -> Drawing:
    """Draw a figure, write its files to ``folder`` and return it for the page; see `figure_files`."""
    document = figure_files.write(folder, name, draw, *arguments)
    return Drawing(Markup(figure_files.inline(document, name.split("-")[0], description)), caption, name)
