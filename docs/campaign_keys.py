"""Write campaign-keys.csv from the records and the models: ``python docs/campaign_keys.py``."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lpfcosim.cli.new import json_schema
from lpfcosim.models import SpacecraftModel, registered

KEYS = Path(__file__).with_name("campaign-keys.csv")
HEADING = ("table", "key", "spacecraft", "value", "default")
TABLES = {  # in the order of a campaign file; their keys are those of every spacecraft
    "Authority": "[authority.NAME]",
    "Events": "[events]",
    "Plateau": "entry of events.plateau",
    "Sine": "injection of shape sine",
    "HalfCosine": "injection of shape half_cosine",
    "Experiment": "[[experiments]], [defaults]",
    "Replacement": "[fmus.MODEL]",
    "DesignTable": "[design]",
    "CapTable": "[design.limits.QUANTITY]",
    "IdentifyTable": "[identify.MODEL.PARAMETER]",
}


def keys() -> list[tuple[str, str, str, str, str]]:
    """Return table, key, spacecraft, value and default of every key."""
    schema = json_schema()
    parts = [("top level", schema), *((TABLES[name], schema["$defs"][name]) for name in TABLES)]
    declared = {key for model in registered().values() for key in model.authority_keys}
    rows = []
    for head, part in parts:
        required = part.get("required", schema["anyOf"][1]["required"])
        for name, known in part["properties"].items():
            if head != TABLES["Authority"] or name not in declared:
                default = "required" if name in required else _default(known.get("default"))
                rows.append((head, name, "all", _value(known), default))
    of_spacecraft: dict[tuple[str, str, str, str], list[str]] = {}
    for model in registered().values():
        for row in _declared(model):
            of_spacecraft.setdefault(row, []).append(model.key)
    rows += [(head, key, " ".join(crafts), *rest) for (head, key, *rest), crafts in of_spacecraft.items()]
    return rows


def _declared(model: SpacecraftModel) -> Iterator[tuple[str, str, str, str]]:
    """Yield table, key, value and default of the keys that a spacecraft declares."""
    laws = model.stated_control
    tables = [("[truth], [inertial_period.K]", model.truth_keys, model.defaults)]
    tables += [
        ("[authority.NAME]", model.authority_keys, model.stated_limits),
        ("[noise]", model.noise_keys, {}),
    ]
    tables += [(f"[control.{name}]", known, laws[name]) for name, known in model.control_keys.items()]
    for head, known, defaults in tables:
        for key, quantity in known.items():
            signs = {"any": "", "not negative": ", zero or above", "not positive": ", zero or below"}
            value = f"{quantity.unit or 'a number'}{signs[quantity.sign]}"
            yield head, key, value, _default(defaults.get(key))


def _value(known: dict[str, Any]) -> str:
    """Say in words what a key takes, with an example."""
    choices = [choice for choice in known.get("anyOf", [known]) if choice.get("type") != "null"]
    one = choices[0]
    if "enum" in one:
        return " or ".join(f'"{value}"' for value in one["enum"])
    if "const" in one:
        return f'"{one["const"]}"'
    words = one.get("description", "") if "properties" not in one else ""
    if not words:
        kinds = {"array": "a list", "object": "a table", None: "a table", "string": "a text"}
        words = kinds.get(one.get("type"), f"a{'n' * (one.get('type') == 'integer')} {one.get('type')}")
    examples = [f'"{e}"' if one.get("type") == "string" else f"{e}" for e in one.get("examples", ())]
    return f"{words}, such as {examples[0]}" if examples else words


def _default(value: object) -> str:
    if value in (None, "") or isinstance(value, dict | list):
        return ""
    if isinstance(value, bool):
        return str(value).lower()  # as TOML has it
    return f"{value:g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    with KEYS.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([HEADING, *keys()])
