"""Text files from anywhere, TOML and JSON: read if they are files of a size that makes sense.

A key that a table of TOML does not know or misses is named before anything else.
"""

import json
import re
import tomllib
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError, model_validator

from fit.errors import InputError, shown
from fit.files.faults import closest_match, problem, validation_messages

MAX_SIZE = 2**24  # bytes
MAX_TOML = 2**20  # bytes; what is written by hand
_Content = TypeVar("_Content")


class Table(BaseModel):
    """Keys and values: its fields, and keys that match `more_keys`, of which `more_known` are examples."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    more_keys: ClassVar[re.Pattern[str] | None] = None
    more_known: ClassVar[tuple[str, ...]] = ()

    @model_validator(mode="before")
    @classmethod
    def _keys(cls, raw: object) -> object:
        if not isinstance(raw, dict):
            raise problem("expected a table of keys and values")
        fields = {field.alias or name: field for name, field in cls.model_fields.items()}
        for key in raw:
            if key not in fields and not (cls.more_keys and cls.more_keys.fullmatch(key)):
                raise problem(f"unknown key{closest_match(key, [*fields, *cls.more_known])}", key)
        for key, field in fields.items():
            if field.is_required() and key not in raw:
                quantities = [f'{key} = "{m.example}"' for m in field.metadata if hasattr(m, "example")]
                raise problem(f"missing, write {(quantities or field.examples or [f'{key} = …'])[0]}", key)
        return raw


def text(path: Path, kind: str, largest: int = MAX_SIZE) -> str:
    """Return the text of a file.

    Parameters
    ----------
    kind : str
        What was expected, for messages: ``"a map"``.
    largest : int
        Size that is refused if exceeded [bytes].

    Raises
    ------
    InputError
        If it cannot be read, is too large or is not UTF-8.
    """
    try:
        if not path.is_file():  # a device may have no end, and a pipe no beginning
            known = "is a folder" if path.is_dir() else "is not a file" if path.exists() else "no such file"
            raise InputError(f"{path}: {known}, expected {kind}")
        with path.open("rb") as file:
            content = file.read(largest + 1)
        if len(content) > largest:
            raise InputError(f"{path}: is larger than {largest} bytes, expected {kind}")
        return content.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}), expected {kind}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text (byte {error.start}), expected {kind}") from None


def toml(path: Path, kind: str) -> dict[str, Any]:
    """Return what a TOML file says; InputError as `text`, or if it is not TOML."""
    content = text(path, kind, MAX_TOML)
    try:
        return tomllib.loads(content)
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply, expected {kind}") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())[:300]}") from None
    except ValueError:  # what is left: Python refuses to convert thousands of digits
        raise InputError(f"{path}: holds a number of too many digits, expected {kind}") from None


def from_json(path: Path, kind: str, schema: str, content: type[_Content]) -> _Content:
    """Return what a JSON file says; InputError as `text`, or if it is no JSON or breaks its schema."""
    document = text(path, kind)
    try:
        found_schema = json.loads(document).get("schema")
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise InputError(f"{path}: {place}: not JSON, expected a JSON object of schema {schema!r}") from None
    except (ValueError, AttributeError, RecursionError) as error:
        raise InputError(f"{path}: expected a JSON object of schema {schema!r}") from error
    if found_schema != schema:
        raise InputError(f"{path}: schema is {shown(found_schema)}, expected {schema!r}")
    try:
        return TypeAdapter(content).validate_json(document)
    except ValidationError as error:
        raise InputError(f"{path}: {validation_messages(error)}") from error


def is_file(path: Path) -> bool:
    """Return whether there is a file, be its name one that no file can have."""
    try:
        return path.is_file()
    except OSError:
        return False


def short_path(path: Path) -> Path:
    """Return a path for messages: relative to the working directory if it lies in there."""
    try:
        return path.relative_to(Path.cwd())
    except (ValueError, OSError):
        return path
