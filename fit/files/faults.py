"""What is wrong with a document, in one sentence with its place and the words of pydantic."""

import difflib
import re
from collections.abc import Collection, Iterable

from pydantic import ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from fit.errors import quote, shown

MOST_NAMES, MOST_SIMILAR = 20, 6  # that are listed: of all names, and of more of them the most similar
_NAME = re.compile(r"[\w-]{1,80}")


def problem(text: str, key: str | None = None) -> PydanticCustomError:
    """Make an error that is passed on word by word, about a value or about one key of a table."""
    return PydanticCustomError("problem", "{text}", {"text": text, "key": key})


def closest_match(name: str, known: Iterable[str]) -> str:
    """Say which names there are, the most similar ones of many, and which one was probably meant."""
    names, listed = sorted(known), "known"
    folded = {known.casefold(): known for known in names}
    close = difflib.get_close_matches(name.casefold(), folded, n=1)
    suggestion = f', did you mean "{folded[close[0]]}"?' if close else ""
    if len(names) > MOST_NAMES:
        listed = f"the most similar of {len(names)}"
        names = difflib.get_close_matches(name, names, n=MOST_SIMILAR, cutoff=0)
    return f"{suggestion} ({listed}: {', '.join(names) if names else 'none'})"


def key(name: str) -> str:
    """Return a key as it stands, or in quotes and cut if it is no plain name."""
    return name if _NAME.fullmatch(name) else quote(name)


def place(loc: Iterable[int | str]) -> str:
    """Return a place in a document as one would write it: ``runs[2].file``."""
    steps = (f"[{p}]" if isinstance(p, int) else f".{key(p)}" for p in loc)
    return "".join(steps).removeprefix(".")


def validation_messages(error: ValidationError, tags: Collection[str] = (), *, written: bool = True) -> str:
    """Say the first thing that pydantic found at fault, with its place.

    Parameters
    ----------
    error : ValidationError
        What pydantic says.
    tags : collection of str
        Names that distinguish the tables of one list.
    written : bool
        Whether the input was written as TOML or JSON, as which messages show it.
    """
    try:
        loc, text = _described(error.errors()[0], tags, written=written)
    except RecursionError:  # the offending value itself is to be shown
        return "is nested too deeply"
    return f"{place(loc)}: {text}" if loc else text


def _described(fault: ErrorDetails, tags: Collection[str], *, written: bool) -> tuple[list[int | str], str]:
    """Return where the fault is and what it is."""
    kind, context = fault["type"], fault.get("ctx", {})
    value = quote(fault["input"]) if written else shown(fault["input"])
    # pydantic puts the chosen tag behind the index in a list, and marks keys that are at fault
    loc = [
        part
        for previous, part in zip([None, *fault["loc"]], fault["loc"], strict=False)
        if part != "[key]" and not (isinstance(previous, int) and part in tags)
    ]
    if kind == "problem":
        return [*loc, *([context["key"]] if context["key"] is not None else [])], fault["msg"]
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        loc.append(name := context["discriminator"].strip("'"))
        if kind == "union_tag_not_found":
            return loc, "missing, write " + " or ".join(f'{name} = "{tag}"' for tag in tags)
        return loc, f"{quote(context['tag'])} is not known{closest_match(context['tag'], tags)}"
    if kind == "literal_error":
        names = re.findall(r"'([^']*)'", context["expected"])
        return loc, f"{value} is not known{closest_match(str(fault['input']), names)}"
    if kind == "missing":
        return loc, "missing, expected it"
    expected = fault["msg"].removeprefix("Input should be ")
    return loc, f"{value}, expected {expected[0].lower()}{expected[1:]}"
