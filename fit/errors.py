"""The errors of a calibration, sorted by what the user can do about them."""

import json
from reprlib import Repr


class CalibrationError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(CalibrationError):
    """The input is wrong (exit status 2); the message names file, place and what was expected."""


class MissingKeyError(InputError, KeyError):
    """A mapping has no such key: a `KeyError` too, as mappings expect."""

    __str__ = Exception.__str__  # that of KeyError quotes the message


class FitError(CalibrationError):
    """The input is valid, but no valid estimate results (exit status 1)."""


_short = Repr()
_short.maxstring = _short.maxother = 80


def shown(value: object) -> str:
    """Return a value in memory for a message: on one line, and not at length."""
    return _short.repr(value)


def quote(value: object) -> str:
    """Return a value of a document as it is written there: on one line, and not at length."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    if not text.isprintable():  # what would move the cursor, or the letters after it
        text = json.dumps(value, default=str)
    return text if len(text) <= 80 else f"{text[:77]}..."
