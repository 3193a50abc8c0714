"""Tell what is wrong with a campaign file, in one sentence with the place in the file."""

import difflib
import json
import re
from collections.abc import Iterable

from pydantic_core import ErrorDetails, PydanticCustomError

_SAID = {  # what pydantic calls at fault, in our words
    "float_type": "{given} is not a number",
    "int_type": "{given} is not a whole number",
    "int_from_float": "{given} is not a whole number",
    "string_type": "{given} is not a text, write it in quotes",
    "list_type": "{given} is not a list, write [{given}]",
    "greater_than_equal": "{given} is too small, expected {ge:g} or more",
    "greater_than": "{given} is too small, expected more than {gt:g}",
    "less_than_equal": "{given} is too large, expected {le:g} or less",
    "less_than": "{given} is too large, expected less than {lt:g}",
    "finite_number": "{given} is not a finite number",
    "too_short": "has {actual_length} of its values, expected at least {min_length}",
    "too_long": "has {actual_length} of its values, expected at most {max_length}",
}
_TOML = {  # what tomllib says, and what to write instead
    "cannot overwrite a value": "; a key and a [table] stand once, a list of tables is written [[name]]",
    "invalid statement": ", expected key = value or [table]",
    "invalid value": ", a text stands in quotes",
}
SHAPES = ("sine", "half_cosine", "pulse")  # of injections


def quote(text: object) -> str:
    """Show what a file says, on one line and not at length."""
    shown = json.dumps(text, ensure_ascii=False, default=str)
    if not shown.isprintable():  # what would move the cursor, or the letters after it
        shown = json.dumps(text, default=str)
    return shown if len(shown) <= 80 else f"{shown[:77]}..."


def line(said: object) -> str:
    """Show what a library says, or what stands in a file, on one line and not at length."""
    text = " ".join(str(said).split())
    text = text if len(text) <= 300 else f"{text[:297]}..."
    return text if text.isprintable() else ascii(text)[1:-1]


def problem(text: str) -> PydanticCustomError:
    """Make an error that pydantic passes on word by word."""
    return PydanticCustomError("problem", "{text}", {"text": text})


def key_problem(key: str, text: str) -> PydanticCustomError:
    """Make an error about one key of a table."""
    return PydanticCustomError("key", "{text}", {"key": key, "text": text})


def closest(name: str, known: Iterable[str]) -> str:
    """Say which names there are, and which one was probably meant."""
    names = sorted(known)
    folded = {known.casefold(): known for known in names}
    close = difflib.get_close_matches(name.casefold(), folded, n=1)
    hint = f', did you mean "{folded[close[0]]}"?' if close else ""
    return f"{hint} (known: {', '.join(names) if names else 'none'})"


def describe(error: ErrorDetails) -> str:
    """Say what pydantic found at fault in a `CampaignTable`, with its place in the file."""
    loc, context = list(error["loc"]), error.get("ctx", {})
    # pydantic puts the chosen shape behind the index of an injection, and marks keys that are at fault
    loc = [
        part
        for before, part in zip([None, *loc], loc, strict=False)
        if part != "[key]" and not (isinstance(before, int) and part in SHAPES)
    ]
    given = quote(error["input"])
    kind = error["type"]
    if kind in ("key", "problem"):
        loc += [context["key"]] if kind == "key" else []
        text = error["msg"]
    elif kind == "union_tag_not_found":
        loc.append("shape")
        text = "missing, write " + " or ".join(f'shape = "{shape}"' for shape in SHAPES)
    elif kind in ("literal_error", "union_tag_invalid"):
        names = re.findall(r"'([^']*)'", str(context.get("expected", context.get("expected_tags"))))
        if kind == "union_tag_invalid":
            loc.append("shape")
            given = quote(context["tag"])
        text = f"{given} is not known{closest(given.strip(chr(34)), names)}"
    elif kind in _SAID:
        text = _SAID[kind].format(given=given, **context)
        if kind in ("float_type", "int_type") and isinstance(error["input"], str):
            text += ", write it without quotes"
    else:
        text = f"{error['msg'][0].lower()}{error['msg'][1:]}, got {given}"
    keys = [str(part) if re.fullmatch(r"[\w-]{1,80}", str(part)) else quote(part) for part in loc]
    path = "".join(
        f"[{key}]" if isinstance(part, int) else f".{key}" for part, key in zip(loc, keys, strict=True)
    )
    return f"{path.removeprefix('.')}: {text}"


def toml_problem(message: str) -> str:
    """Turn tomllib's "What (at line 3, column 5)" into "line 3, column 5: what", and say what to write."""
    match = re.fullmatch(r"(.*) \(at (.*)\)", message, flags=re.DOTALL)
    if not match:
        return message
    what = f"{match[1][0].lower()}{match[1][1:]}"
    return f"{match[2]}: {what}{_TOML.get(what, '')}"
