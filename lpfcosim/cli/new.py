"""The command ``new``: a campaign to start from."""

import shutil
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from lpfcosim.campaign import names
from lpfcosim.errors import InputError

ROOM = Path(__file__).parents[1] / "campaign"
STARTER = Path("quickstart.toml")  # in that room in a wheel, among the campaigns in a checkout
JSON_SCHEMA = Path("lpf-campaign.json")  # in that room, what `lpfcosim schema` prints


def new(file: Path) -> None:
    """Write a commented starter campaign, and its JSON Schema beside it for editors."""
    if file.suffix != ".toml":
        raise InputError(f"{file}: expected a name that ends in .toml, such as {file.with_suffix('.toml')}")
    try:
        TypeAdapter(names.Name).validate_python(file.stem)
    except ValidationError as error:
        raise InputError(f"{file}: {error.errors()[0]['msg']}") from None
    text = starter().replace('name = "quickstart"', f'name = "{file.stem}"')
    text = text.replace("campaigns/quickstart.toml", file.name)
    try:
        with file.open("x", encoding="utf-8") as written:
            written.write(f"#:schema ./{JSON_SCHEMA}\n{text}")
    except FileExistsError:
        raise InputError(f"{file}: is there already, expected a new name") from None
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{file}: {file.parent} is not a folder, expected one that is there") from None
    beside = file.with_name(JSON_SCHEMA.name)
    if not beside.exists():
        shutil.copyfile(ROOM / JSON_SCHEMA, beside)
    print(f"{file}: written; see what it will tell with: lpfcosim check {file}")


def starter() -> str:
    """Return the text of the quick start, as the wheel or the checkout has it."""
    packaged = ROOM / STARTER
    path = packaged if packaged.is_file() else ROOM.parents[1] / "campaigns" / STARTER
    return path.read_text(encoding="utf-8")
