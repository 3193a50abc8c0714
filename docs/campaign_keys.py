"""Write campaign-keys.csv from the schema of campaigns: ``python docs/campaign_keys.py``."""

import csv
import re
from pathlib import Path
from typing import Any

from lpfcosim.cli.new import json_schema

KEYS = Path(__file__).with_name("campaign-keys.csv")
HEADING = ("table", "key", "value", "default")
TABLES = {  # in the order of a campaign file
    "TruthTable": "[truth]",
    "AuthorityTable": "[authority.NAME]",
    "NoiseTable": "[noise]",
    "EventsTable": "[events]",
    "PlateauTable": "entry of events.plateau",
    "ActuationTable": "[actuation]",
    "SineTable": "injection of shape sine",
    "TaperedSineTable": "injection of shape tapered_sine",
    "HalfCosineTable": "injection of shape half_cosine",
    "ExperimentTable": "[[experiments]]",
    "DefaultsTable": "[defaults]",
    "SweepTable": "[sweep]",
    "ControllerTable": "[control.drag_free], [control.suspension]",
    "AttitudeTable": "[control.attitude]",
    "SpacecraftTable": "[spacecraft]",
    "MisalignmentTable": "[spacecraft.period.K]",
    "FmuTable": "[fmus.MODEL]",
    "DesignTable": "[design]",
    "CapTable": "[design.limits.QUANTITY]",
    "IdentifyTable": "[identify.MODEL.PARAMETER]",
}


def keys() -> list[tuple[str, str, str, str]]:
    """Return table, key, value and default of every key."""
    schema = json_schema(declared=False)
    rows = []
    for head, part in _parts(schema):
        required = set(part.get("required", schema["anyOf"][1]["required"] if part is schema else ()))
        for name, key in part["properties"].items():
            default = "required" if name in required else _default(key)
            rows.append((head, name, _value(key).replace("`", ""), default.replace("`", "")))
    return rows


def _parts(schema: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    return [("top level", schema)] + [(TABLES[name], schema["$defs"][name]) for name in TABLES]


def _value(known: dict[str, Any]) -> str:
    """Say in words what a key takes, with an example."""
    choices = [choice for choice in known.get("anyOf", [known]) if choice.get("type") != "null"]
    one = choices[0]
    if "enum" in one:
        return " or ".join(f'`"{value}"`' for value in one["enum"])
    if "const" in one:
        return f'`"{one["const"]}"`'
    if one.get("type") == "array" and "description" in one["items"]:
        return f"a list: {_value(one['items'])}"
    words = one.get("description", "") if "properties" not in one else ""
    if not words:
        words = {"array": "a list", "object": "a table", None: "a table", "string": "a text"}.get(
            one.get("type"), f"a{'n' * (one.get('type') == 'integer')} {one.get('type')}"
        )
    examples = [re.sub(r"^\w+ = ", "", example).strip('"') for example in one.get("examples", ())]
    shown = [f'`"{e}"`' if one.get("type") == "string" else f"`{e}`" for e in examples]
    return f"{words}, such as {shown[0]}" if shown else words


def _default(known: dict[str, Any]) -> str:
    value = known.get("default")
    if value in (None, "") or isinstance(value, dict | list):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"  # as TOML has it
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


if __name__ == "__main__":
    with KEYS.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([HEADING, *keys()])
