"""The command ``new``: a campaign or a map of archives to start from."""

import json
import shlex
from collections.abc import Sequence
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from lpfcosim.campaign import names
from lpfcosim.errors import InputError

ROOM = Path(__file__).parents[1] / "campaign"
STARTER = Path("quickstart.toml")  # in that room in a wheel, among the campaigns in a checkout
JSON_SCHEMA = "lpf-campaign.json"  # what `lpfcosim schema` prints
MAP_SCHEMA = "lpf-map.json"  # what `lpfcosim schema --map` prints


def new(files: Sequence[Path]) -> None:
    """Write a commented starter campaign, and next to it its JSON Schema for editors."""
    from lpfcosim.cli.schema import json_schema  # takes its time, which a map need not

    file = files[0] if files else Path("campaign.toml")
    if len(files) > 1:
        raise InputError(
            f"{files[1]}: expected one name; archives are described by a map: lpfcosim new --map"
        )
    _check_suffix(file)
    try:
        TypeAdapter(names.Name).validate_python(file.stem)
    except ValidationError as error:
        raise InputError(f"{file}: {error.errors()[0]['msg']}") from None
    text = starter().replace('name = "quickstart"', f'name = "{file.stem}"')
    text = text.replace("campaigns/quickstart.toml", file.name)
    _write(file, text, JSON_SCHEMA, json.dumps(json_schema(), indent=1))
    print(f"{file}: written; to check it: lpfcosim check {file}")


def new_map(files: Sequence[Path]) -> None:
    """Write a commented map of archives, and next to it its JSON Schema for editors."""
    from fit.telemetry import maps  # takes its time, which a campaign need not

    file = files[0] if files else Path("map.toml")
    if len(files) > 1:
        raise InputError(f"{files[1]}: expected one name that ends in .toml")
    _check_suffix(file)
    _write(file, maps.template(file.name), MAP_SCHEMA, json.dumps(maps.json_schema(), indent=1))
    print(f"{file}: written; fill it in, then: lpfcosim fit {shlex.quote(str(file))}")


def starter() -> str:
    """Return the text of the quick start, as the wheel or the checkout has it."""
    packaged = ROOM / STARTER
    path = packaged if packaged.is_file() else ROOM.parents[1] / "campaigns" / STARTER
    return path.read_text(encoding="utf-8")


def _check_suffix(file: Path) -> None:
    if file.suffix != ".toml":
        raise InputError(f"{file}: expected a name that ends in .toml, such as {file.with_suffix('.toml')}")


def _write(file: Path, text: str, schema: str, content: str) -> None:
    """Write a new file that names its JSON Schema, and the schema next to it unless there is one."""
    try:
        with file.open("x", encoding="utf-8") as written:
            written.write(f"#:schema ./{schema}\n{text}")
    except FileExistsError:
        raise InputError(f"{file}: exists already, expected a new name") from None
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{file}: {file.parent} is not a folder, expected an existing one") from None
    schema_file = file.with_name(schema)
    if not schema_file.exists():
        schema_file.write_text(content, encoding="utf-8")
