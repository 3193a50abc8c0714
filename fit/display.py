"""How results and telemetry show themselves: as text in a terminal, as HTML in a notebook, as LaTeX.

`fit.tables.notebook` registers what each type looks like. It imports the types, so they cannot import it:
they import this file.
"""

from functools import singledispatch


@singledispatch
def text(value: object) -> str:
    """Return a value as plain text of a few lines."""
    return f"<{type(value).__name__}>"


@singledispatch
def html(value: object) -> str | None:  # noqa: ARG001 - what it is decides
    """Return a value as an element of a page, None where it has no such form."""
    return None


@singledispatch
def latex(value: object) -> str:
    """Return a value as LaTeX."""
    return text(value)


class Displayed:
    """Shows itself as `text` and `html` say."""

    def __repr__(self) -> str:
        return text(self)

    def _repr_html_(self) -> str | None:
        """Return what Jupyter shows."""
        page = html(self)
        return None if page is None else str(page)
