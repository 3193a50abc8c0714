"""The command ``schema``: the JSON Schema of a campaign file, or of a map of archives."""

import json
from typing import Any

from fit import settings as fit_settings
from fit.telemetry import map_draft
from lpfcosim.campaign import schema


def print_schema(*, as_map: bool) -> None:
    """Print the JSON Schema of a campaign file, as ``campaign/lpf-campaign.json`` has it, or of a map."""
    print(json.dumps(map_draft.json_schema() if as_map else json_schema(), indent=1))


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file, what the fit reads of it included."""
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
    # a file that extends another has from there what it does not say
    json_tables["anyOf"] = [{"required": ["extends"]}, {"required": json_tables.pop("required")}]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **json_tables}
