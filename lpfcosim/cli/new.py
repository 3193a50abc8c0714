"""Campaigns and maps of archives to start from, and the JSON Schema of both for editors."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from fit import settings as fit_settings
from lpfcosim.campaign import Campaign, loading
from lpfcosim.errors import InputError
from lpfcosim.models import registered
from lpfcosim.quantities import Quantity

ROOM = Path(__file__).parents[1] / "campaign"
STARTER = Path("quickstart.toml")  # in that room in a wheel, among the campaigns in a checkout


def write_campaign(file: Path | None) -> Path:
    """Write a commented starter campaign, and next to it its JSON Schema; return the campaign."""
    path = file or Path("campaign.toml")
    loading.check_stem(path)
    text = starter().replace('name = "quickstart"', f'name = "{path.stem}"')
    text = text.replace("campaigns/quickstart.toml", path.name)
    return _write(path, text, "lpf-campaign.json", json_schema())


def write_map(file: Path | None) -> Path:
    """Write a commented map of archives, and next to it its JSON Schema; return the map."""
    from fit.telemetry import maps

    path = file or Path("map.toml")
    return _write(path, maps.template(path.name), "lpf-map.json", maps.json_schema())


def starter() -> str:
    """Return the text of the quick start, as the wheel or the checkout has it."""
    packaged = ROOM / STARTER
    path = packaged if packaged.is_file() else ROOM.parents[1] / "campaigns" / STARTER
    return path.read_text(encoding="utf-8")


def _write(file: Path, text: str, schema_name: str, content: dict[str, Any]) -> Path:
    """Write a new file that names its JSON Schema, and the schema next to it unless there is one."""
    if file.suffix != ".toml":
        raise InputError(f"{file}: expected a name that ends in .toml, such as {file.with_suffix('.toml')}")
    try:
        with file.open("x", encoding="utf-8") as written:
            written.write(f"#:schema ./{schema_name}\n{text}")
    except FileExistsError:
        raise InputError(f"{file}: exists already, expected a new name") from None
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{file}: {file.parent} is not a folder, expected an existing one") from None
    if not file.with_name(schema_name).exists():
        file.with_name(schema_name).write_text(json.dumps(content, indent=1), encoding="utf-8")
    return file


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file of any spacecraft, with what the fit reads of it."""
    tables = TypeAdapter(Campaign).json_schema()
    shapes, keys = tables["$defs"], tables["properties"]
    del keys["tables"]
    for shape in shapes.values():
        shape["additionalProperties"] = False
    shapes["Experiment"]["required"] = ["name"]  # defaults may have the rest
    keys["fit"] = _of_fit(shapes)
    for shape in ("Sine", "HalfCosine"):  # its unit depends on the target
        shapes[shape]["properties"]["amplitude"]["type"] = "string"
        shapes[shape]["required"].append("shape")
    for record, key in (("Authority", "name"), ("Replacement", "model")):  # the name of their table
        del shapes[record]["properties"][key]
        shapes[record]["required"].remove(key)
    del shapes["Authority"]["properties"]["others"]
    names = {"type": "array", "items": {"type": "string"}}
    injections = shapes["Experiment"]["properties"]["injections"]
    shapes["Experiment"]["properties"] |= {"sequences": names}
    models = registered().values()
    of_truth = _described(m.truth_keys for m in models)
    of_noise = _described(m.noise_keys for m in models)
    laws = {model: _described([known]) for m in models for model, known in m.control_keys.items()}
    shapes["Authority"]["properties"] |= _described(m.authority_keys for m in models)["properties"]
    keys["truth"] = of_truth
    keys["inertial_period"]["additionalProperties"] = of_truth
    keys["noise"] = shapes["Experiment"]["properties"]["noise"] = of_noise
    keys["control"] = {"type": "object", "properties": laws, "additionalProperties": False}
    keys["spacecraft"] |= {"enum": list(registered())}
    keys |= {
        "schema": {"const": loading.SCHEMA},
        "extends": {"type": "string", "description": "a campaign file to which this one adds"},
        "sequences": {"type": "object", "additionalProperties": injections},
        "defaults": {**shapes["Experiment"], "required": []},
        "sweep": {"type": "object", "additionalProperties": names},
    }
    # a file that extends another has from there what it does not say
    required = ["schema", *tables.pop("required")]
    tables["additionalProperties"] = False
    tables["anyOf"] = [{"required": ["extends"]}, {"required": required}]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **tables}


def _described(tables: Iterable[Mapping[str, Quantity]]) -> dict[str, Any]:
    """Return the JSON Schema of a table whose keys the spacecraft models declare."""
    values = {key: quantity.json_schema() for table in tables for key, quantity in table.items()}
    return {"type": "object", "properties": values, "additionalProperties": False}


def _of_fit(shapes: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON Schema of ``[fit]``; adds to the shapes of the whole."""
    of_fit = fit_settings.Settings.model_json_schema()
    default = fit_settings.settings().model_dump()
    del of_fit["required"]
    shapes |= of_fit.pop("$defs")
    for name, known in of_fit["properties"].items():
        known["default"] = default[name]
    shared = of_fit["properties"]["shared"]
    group = shared.pop("additionalProperties")
    shared |= {"properties": dict.fromkeys(default["shared"], group), "additionalProperties": False}
    return of_fit
