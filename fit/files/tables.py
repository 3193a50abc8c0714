"""A table of a TOML document: a key that it does not know or misses is said before anything else."""

import re
from typing import ClassVar

from pydantic import BaseModel, ConfigDict, model_validator

from fit.files.faults import closest_match, problem


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
