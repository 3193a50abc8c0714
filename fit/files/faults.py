"""What is wrong with a document, in one sentence with its place: the errors of pydantic in our words."""

import difflib
import re
from collections.abc import Collection, Iterable

from pydantic import ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from fit.errors import quote, shown

_WORDING = {  # what pydantic calls at fault, in our words, and how it is written in a document
    "float_type": ("{given} is not a number", ""),
    "int_type": ("{given} is not a whole number", ""),
    "int_from_float": ("{given} is not a whole number", ""),
    "string_type": ("{given} is not a text", "write it in quotes"),
    "list_type": ("{given} is not a list", "write [{given}]"),
    "dict_type": ("{given} is not a table of keys and values", ""),
    "bool_type": ("{given}, expected true or false", ""),
    "missing": ("missing, expected it", ""),
    "greater_than_equal": ("{given} is too small, expected {ge:g} or more", ""),
    "greater_than": ("{given} is too small, expected more than {gt:g}", ""),
    "less_than_equal": ("{given} is too large, expected {le:g} or less", ""),
    "less_than": ("{given} is too large, expected less than {lt:g}", ""),
    "finite_number": ("{given} is not a finite number", ""),
    "too_short": ("is of length {actual_length}, expected at least {min_length}", ""),
    "too_long": ("is of length {actual_length}, expected at most {max_length}", ""),
}
_NAME = re.compile(r"[\w-]{1,80}")


def problem(text: str, key: str | None = None) -> PydanticCustomError:
    """Make an error that is passed on word by word, about a value or about one key of a table."""
    return PydanticCustomError("problem", "{text}", {"text": text, "key": key})


def closest_match(name: str, known: Iterable[str]) -> str:
    """Say which names there are, and which one was probably meant."""
    names = sorted(known)
    return f"{suggestion(name, names)} (known: {', '.join(names) if names else 'none'})"


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the question whether the most similar of the known names was meant; empty if none is similar."""
    folded = {known.casefold(): known for known in sorted(known)}
    close = difflib.get_close_matches(name.casefold(), folded, n=1)
    return f', did you mean "{folded[close[0]]}"?' if close else ""


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
        Whether the input was written as TOML or JSON, so that messages say how to write it.
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
        expected = (
            closest_match(str(fault["input"]), names) if written else f", expected one of {', '.join(names)}"
        )
        return loc, f"{value} is not known{expected}"
    if kind not in _WORDING:
        return loc, f"{value}, expected: {fault['msg'][0].lower()}{fault['msg'][1:]}"
    text, advice = _WORDING[kind]
    if kind in ("float_type", "int_type") and isinstance(fault["input"], str):
        advice = "write it without quotes"
    text = f"{text}, {advice}" if advice and written else text
    text = text.format(given=value, **context)
    return loc, text if written or "expected" in text else f"{text}, expected one"
