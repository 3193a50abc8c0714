"""A figure of the report: written as a file, and as an element of the page."""

from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from fit import figures


@dataclass(frozen=True)
class Drawing:
    """A figure of the page: an SVG element and what to see in it."""

    svg: Markup
    caption: str


def drawing(folder: Path, name: str, description: str, caption: str, document: str) -> Drawing:
    """Write an SVG document to ``folder`` and return it for the page; see `figures.inline`."""
    (folder / f"{name}.svg").write_text(document, encoding="utf-8")
    return Drawing(Markup(figures.inline(document, name.split("-")[0], description)), caption)
