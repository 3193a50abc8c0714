"""Campaigns and maps of archives to start from, and the JSON Schema of both for editors."""

import json
from pathlib import Path
from typing import Any

from fit import settings as fit_settings
from lpfcosim.campaign import schema
from lpfcosim.errors import InputError
from lpfcosim.models import SpacecraftModel, registered

ROOM = Path(__file__).parents[1] / "campaign"
STARTER = Path("quickstart.toml")  # in that room in a wheel, among the campaigns in a checkout


def write_campaign(file: Path | None) -> Path:
    """Write a commented starter campaign, and next to it its JSON Schema; return the campaign."""
    from lpfcosim.campaign import names

    path = file or Path("campaign.toml")
    names.check_stem(path)
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
