"""What a user may choose about a fit: table ``[fit]`` of a campaign or of a file of settings."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, ConfigDict, ValidationError

from fit.errors import InputError, quote
from fit.files import Table, closest, documents, key, told

Estimator = Literal["gaussian", "student_t", "marginalised", "flscov"]  # of the likelihood, or LTPDA's
Group = Literal["campaign", "alignment_epoch", "experiment"]  # over which a parameter has one value
#: What may depart from experiment to experiment; "auto" stands alone: what the data ask for.
_Scattering = Literal["auto", "lambda_1", "lambda_2", "C_1", "C_2", "slope_1", "slope_2", "bend_1", "bend_2"]
_AUTO = BeforeValidator(lambda given: ["auto"] if given == "auto" else given)


class Settings(Table):
    """The choices, as ``fit/default.toml`` explains them."""

    model_config = ConfigDict(strict=True)

    estimator: Estimator
    include_short: bool
    exclude: list[str]
    glitches: bool
    scatter: Annotated[list[_Scattering], _AUTO]
    levels: Annotated[list[str], _AUTO]
    shared: dict[str, Group]


def settings(chosen: Mapping[str, object] | None = None, where: str = "[fit]") -> Settings:
    """Return the settings with what is chosen on top of the default.

    Parameters
    ----------
    chosen : mapping, optional
        A table ``[fit]``, in part or whole.
    where : str
        The place it was found at, for messages.

    Raises
    ------
    InputError
        If a key or a value is not known.
    """
    default = documents.toml(Path(__file__).with_name("default.toml"), "settings")["fit"]
    chosen = dict(chosen or {})
    shared, known = chosen.pop("shared", {}), default.pop("shared")
    if not isinstance(shared, Mapping):
        raise InputError(f"{where}.shared: {quote(shared)}, expected a table of parameters")
    for name in shared:
        if name not in known:
            raise InputError(f"{where}.shared.{key(name)}: unknown key{closest(name, known)}")
    try:
        found = Settings.model_validate({**default, **chosen, "shared": {**known, **shared}})
    except ValidationError as error:
        raise InputError(f"{where}.{told(error)}") from error
    if len(set(found.scatter)) < len(found.scatter):
        raise InputError(f"{where}.scatter: {', '.join(found.scatter)}: expected each parameter once")
    if "auto" in found.scatter and len(found.scatter) > 1:
        raise InputError(f'{where}.scatter: {", ".join(found.scatter)}: expected "auto" alone')
    for name in found.scatter:
        if found.shared.get(name, "campaign") != "campaign":
            raise InputError(
                f"{where}.scatter: {name} has a value for each {found.shared[name]} already, "
                'expected shared = "campaign"'
            )
    return found


def read(path: Path) -> Settings:
    """Read the settings in a TOML file with a table ``[fit]``, be it a campaign or not.

    Raises
    ------
    InputError
        If the file cannot be read, has no such table or breaks it.
    """
    table = documents.toml(path, "a file of settings").get("fit")
    if not isinstance(table, dict):
        raise InputError(f"{path}: no table [fit], expected one with the settings of the fit")
    return settings(table, f"{path}: fit")
