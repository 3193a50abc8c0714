"""What a library says, or what stands in a file, for a message of ours; one cause of many runs said once."""

import re
from collections.abc import Iterable, Sequence

_MAX_NAMES = 8  # names in a row
_DECIMAL = re.compile(r"\d+\.\d+(e[-+]?\d+)?")  # a time, or what an FMU says of a value


def line(value: object) -> str:
    """Show it on one line and not at length."""
    text = " ".join(str(value).split())
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
    sentences: dict[str, dict[str, str]] = {}
    for name, cause in causes:
        sentences.setdefault(_DECIMAL.sub("", _bare(name, cause, noun)), {}).setdefault(name, cause)
    return [_sentence(causes_by_name, noun) for causes_by_name in sentences.values()]


def names(name_list: Sequence[str]) -> str:
    """Return names in a row, not more than a few."""
    suffix = f" and {len(name_list) - _MAX_NAMES} more" if len(name_list) > _MAX_NAMES else ""
    return ", ".join(name_list[:_MAX_NAMES]) + suffix


def _sentence(causes: dict[str, str], noun: str) -> str:
    """Return one sentence about all of some names, whose causes are the same."""
    (name, cause), *other_causes = causes.items()
    bare = _bare(name, cause, noun)
    if not other_causes:
        return cause if bare != cause else f"{noun} {name}: {cause}"
    differ = len({_bare(subject, text, noun) for subject, text in causes.items()}) > 1
    example = f" ({name}; the others with other numbers)" if differ else ""
    return f"{noun}s {names(list(causes))}: {bare}{example}"


def _bare(name: str, cause: str, noun: str) -> str:
    """Return a cause without the name it is about."""
    bare = re.sub(rf"^{noun} (['\"]?){re.escape(name)}\1:? ", "", cause)
    return re.sub(rf"(?<![\w.-]){re.escape(name)}(?=\.(?:h5|log)\b)", "RUN", bare)
