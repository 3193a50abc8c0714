"""What is wrong with a campaign file, in one sentence with its place in the file."""

import difflib
import json
import re
from collections.abc import Iterable

from pydantic_core import ErrorDetails, PydanticCustomError

SHAPES = ("sine", "half_cosine", "pulse")  # of injections


def quote(text: object) -> str:
    """Show what a file says, on one line and not at length."""
    shown = json.dumps(text, ensure_ascii=False, default=str)
    return shown if len(shown) <= 80 else f"{shown[:77]}..."


def problem(text: str) -> PydanticCustomError:
    """Make an error that pydantic passes on word by word."""
    return PydanticCustomError("problem", "{text}", {"text": text})


def key_problem(key: str, text: str) -> PydanticCustomError:
    """Make an error about one key of a table."""
    return PydanticCustomError("key", "{text}", {"key": key, "text": text})


def closest(name: str, known: Iterable[str]) -> str:
    """Say which names there are, and which one was probably meant."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1)
    hint = f', did you mean "{close[0]}"?' if close else ""
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
    else:
        text = f"{error['msg'][0].lower()}{error['msg'][1:]}, got {given}"
    keys = [str(part) if re.fullmatch(r"[\w-]+", str(part)) else quote(part) for part in loc]
    path = "".join(
        f"[{key}]" if isinstance(part, int) else f".{key}" for part, key in zip(loc, keys, strict=True)
    )
    return f"{path.removeprefix('.')}: {text}"
