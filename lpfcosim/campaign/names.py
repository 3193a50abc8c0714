"""Names of campaigns, experiments and runs, which become names of files."""

import re
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Strict, TypeAdapter, ValidationError

from fit.errors import quote
from fit.files import problem
from lpfcosim.errors import InputError


def _usable(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", name) or name.endswith("."):
        raise problem(f'{quote(name)} cannot name a file, use up to 64 letters, digits, "-", "_" and "."')
    if re.fullmatch(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", name.casefold()):
        raise problem(f"{quote(name)} cannot name a file on every system, choose another name")
    return name


def check_stem(path: Path) -> None:
    """Refuse a file whose name, without suffix, cannot name a campaign.

    Raises
    ------
    InputError
        Says what the name may be.
    """
    try:
        TypeAdapter(Name).validate_python(path.stem)
    except ValidationError as error:
        raise InputError(f"{path}: {error.errors()[0]['msg']}") from None


Name = Annotated[str, Strict(), AfterValidator(_usable)]
