"""The command ``schema``: the JSON Schema of a campaign file, or of a map of archives."""

import json
from typing import Any

from fit import settings as fit_settings
from lpfcosim.campaign import schema
from lpfcosim.models import SpacecraftModel, registered


def print_schema(*, as_map: bool) -> None:
    """Print the JSON Schema of a campaign file of LISA Pathfinder, or of a map."""
    if as_map:
        from fit.telemetry import maps  # takes its time, which a campaign need not

        print(json.dumps(maps.json_schema(), indent=1))
    else:
        print(json.dumps(json_schema(), indent=1))


def json_schema(*, declared: bool = True) -> dict[str, Any]:
    """Return the JSON Schema of a campaign file of LISA Pathfinder, what the fit reads of it included.

    Parameters
    ----------
    declared : bool
        With the keys that the spacecraft models declare beyond the fields of the tables.
    """
    json_tables = schema.CampaignTable.model_json_schema()
    of_fit = fit_settings.Settings.model_json_schema()
    default = fit_settings.settings().model_dump()
    del of_fit["required"]
    json_tables["$defs"] |= of_fit.pop("$defs")
    for name, known in of_fit["properties"].items():
        known["default"] = default[name]
    shared = of_fit["properties"]["shared"]
    group = shared.pop("additionalProperties")
    shared |= {"properties": dict.fromkeys(default["shared"], group), "additionalProperties": False}
    json_tables["properties"]["fit"] = of_fit
    for table in ("SineTable", "TaperedSineTable", "HalfCosineTable"):
        # its unit depends on the target: in the file a string, to pydantic the number this becomes
        json_tables["$defs"][table]["properties"]["amplitude"]["type"] = "string"
    for table, units in (("TruthTable", _truth_units()), ("NoiseTable", _noise_units())):
        described = json_tables["$defs"][table]
        described["additionalProperties"] = False
        for name, unit in units.items() if declared else ():
            value = {"type": "string", "description": f"a value in {unit}"} if unit else {"type": "number"}
            described["properties"].setdefault(name, value)
    # a file that extends another has from there what it does not say
    json_tables["anyOf"] = [{"required": ["extends"]}, {"required": json_tables.pop("required")}]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **json_tables}


def _truth_units() -> dict[str, str]:
    """Return the units of the parameters that spacecraft models of LISA Pathfinder leave to a campaign."""
    return {name: model.unit(name) for model in _pathfinders() for name in model.truths}


def _noise_units() -> dict[str, str]:
    """Return the units of the levels of noise that spacecraft models of LISA Pathfinder declare."""
    return {name: unit for model in _pathfinders() for name, unit in model.noise_units.items()}


def _pathfinders() -> list[SpacecraftModel]:
    return [model for key, model in registered().items() if not isinstance(key, str)]
