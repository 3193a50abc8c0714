"""Table ``[identify]`` of a campaign file: the parameters that `lpfcosim identify` looks for."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator

from fit.errors import quote
from fit.files import Table, problem
from lpfcosim.quantities import Number

Shared = Literal["campaign", "alignment_epoch", "experiment"]


class IdentifyTable(Table):
    """[identify.MODEL.PARAMETER]: a parameter that `lpfcosim identify` estimates, in the unit of its FMU.

    Start value, bounds, natural scale ``width`` (a parameter with a larger sigma counts as undetermined), and
    ``shared``: the runs for which it has one value.
    """

    start: Number | None = None
    bounds: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    width: Annotated[Number, Field(gt=0, le=1e60)] | None = None
    shared: Shared | None = None

    @field_validator("bounds")
    @classmethod
    def _ascending(cls, bounds: list[float], info: ValidationInfo) -> list[float]:
        low, high = bounds
        if low >= high:
            raise problem(f"from {low:g} to {high:g}, expected the lower bound first")
        start = info.data.get("start")
        if start is not None and not low <= start <= high:
            raise problem(f"from {low:g} to {high:g}, expected bounds about the start, {start:g}")
        return bounds


def _flat(raw: Any) -> Any:
    """Write ``{Model: {name: …}}`` as ``{"Model.name": …}``, as TOML lets one do."""
    if not isinstance(raw, dict):
        return raw
    entries_by_name: dict[str, Any] = {}
    for key, value in raw.items():
        nested = isinstance(value, dict) and value and all(isinstance(v, dict) for v in value.values())
        entries = {f"{key}.{name}": v for name, v in value.items()} if nested else {key: value}
        for name, entry in entries.items():
            if name in entries_by_name:
                raise problem(f"{quote(name)} is there twice")
            entries_by_name[name] = entry
    return entries_by_name


def _either(schema: dict[str, Any]) -> None:
    """Let editors know both ways to write it."""
    one = schema["additionalProperties"]
    schema["additionalProperties"] = {"anyOf": [one, {"type": "object", "additionalProperties": one}]}


#: By ``Model.parameter``, or by the name that the fit has for it.
IdentifyTables = Annotated[dict[str, IdentifyTable], BeforeValidator(_flat), Field(json_schema_extra=_either)]
