"""What a library says, or what stands in a file, for a message of ours; one cause of many runs said once."""

import re
from collections.abc import Iterable, Sequence

_MOST = 8  # names in a row
_DECIMAL = re.compile(r"\d+\.\d+(e[-+]?\d+)?")  # a time, or what an FMU says of a value


def line(said: object) -> str:
    """Show it on one line and not at length."""
    text = " ".join(str(said).split())
    text = text if len(text) <= 300 else f"{text[:297]}..."
    return text if text.isprintable() else ascii(text)[1:-1]


def grouped(causes: Iterable[tuple[str, str]], noun: str = "run") -> list[str]:
    """Return one sentence for each cause, with the names of all that it holds for.

    Causes are the same if they differ in nothing but the name they are about, and decimal numbers.

    Parameters
    ----------
    causes : iterable of (str, str)
        Names, and what is said of each; it may begin with noun and name, as in ``run 'A': no room``. A name
        may have several causes.
    noun : str
        What the names are names of.
    """
    same: dict[str, dict[str, str]] = {}
    for name, cause in causes:
        same.setdefault(_DECIMAL.sub("", _bare(name, cause, noun)), {}).setdefault(name, cause)
    return [_sentence(of, noun) for of in same.values()]


def names(of: Sequence[str]) -> str:
    """Return names in a row, not more than a few."""
    more = f" and {len(of) - _MOST} more" if len(of) > _MOST else ""
    return ", ".join(of[:_MOST]) + more


def _sentence(causes: dict[str, str], noun: str) -> str:
    """Return one sentence about all of some names, whose causes are the same."""
    (name, cause), *others = causes.items()
    bare = _bare(name, cause, noun)
    if not others:
        return cause if bare != cause else f"{noun} {name}: {cause}"
    differ = len({_bare(each, said, noun) for each, said in causes.items()}) > 1
    at = f" ({name}; the others with other numbers)" if differ else ""
    return f"{noun}s {names(list(causes))}: {bare}{at}"


def _bare(name: str, cause: str, noun: str) -> str:
    """Return a cause without the name it is about."""
    bare = re.sub(rf"^{noun} (['\"]?){re.escape(name)}\1:? ", "", cause)
    return re.sub(rf"(?<![\w.-]){re.escape(name)}(?=\.(?:h5|log)\b)", "RUN", bare)
