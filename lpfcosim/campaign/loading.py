"""A campaign file, ``lpf-campaign/2``: read, together with what it extends, and checked."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from fit.errors import quote
from fit.files import closest_match, documents, validation_messages
from lpfcosim.campaign.campaign import Campaign, Experiment, Injections
from lpfcosim.errors import InputError
from lpfcosim.models import SpacecraftModel, registered
from lpfcosim.quantities import Name
from lpfcosim.spacecraft import SHAPES, Replacement

SCHEMA = "lpf-campaign/2"
DEFAULT_SPACECRAFT = "lpf-x"
_LONGEST_CHAIN = 20  # of files that extend each other
_CONVERSION = (
    f'is of the format before {SCHEMA}: write schema = "{SCHEMA}" and spacecraft = "lpf-x" or "lpf", and '
    "move the keys of [spacecraft] and [actuation] to [truth] and [noise], as CHANGELOG.md has under "
    '"From lpf-campaign/1"'
)


def load(path: Path) -> Campaign:
    """Read a campaign file.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or is not a campaign; one sentence with the path inside it.
    """
    raw = _load_extended(path)
    try:
        return validated(raw)
    except ValidationError as error:
        raise InputError(f"{path}: {validation_messages(error, SHAPES)}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def validated(raw: Mapping[str, Any]) -> Campaign:
    """Return the campaign of the tables of a file and of what it extends; ValidationError, InputError."""
    tables = _swept({key: value for key, value in raw.items() if key not in ("extends", "schema")})
    spacecraft = _spacecraft_model(tables.get("spacecraft", DEFAULT_SPACECRAFT))
    content = {"truth": {}, "control": {}, **tables, "tables": {"schema": SCHEMA, **tables}}
    _complete_experiments(content, spacecraft)
    campaign = TypeAdapter(Campaign).validate_python(content, context=spacecraft)
    _check_replacements(campaign)
    return campaign


def _complete_experiments(content: dict[str, Any], spacecraft: SpacecraftModel) -> None:
    """Complete the experiments of a campaign by its defaults and its sequences.

    Raises
    ------
    ValidationError, InputError
        If one of these tables is wrong, or there is no such sequence.
    """
    sequences, defaults = content.pop("sequences", {}), content.pop("defaults", {})
    validated = TypeAdapter(dict[str, dict[Name, Injections]]).validate_python(
        {"sequences": sequences}, context=spacecraft
    )["sequences"]
    known = {key: value for key, value in _table(defaults, "defaults").items() if key != "sequences"}
    filled = {"defaults": {"name": "defaults", "authority": "A", **known}}
    TypeAdapter(dict[str, Experiment]).validate_python(filled, context=spacecraft)
    if not isinstance(experiments := content.get("experiments"), list):
        return
    content["experiments"] = completed = []
    for i, experiment in enumerate(experiments):
        entry = {**defaults, **_table(experiment, f"experiments[{i}]")}
        names, injections = entry.pop("sequences", []), entry.get("injections", [])
        if not isinstance(names, list) or not isinstance(injections, list):
            raise InputError(f"experiments[{i}]: expected lists of sequences and of injections")
        for name in names:
            if name not in validated:
                match = closest_match(str(name), validated)
                raise InputError(f"experiments[{i}].sequences: no sequence {quote(name)}{match}")
        of_sequences = [injection for name in names for injection in validated[name]]
        completed.append({**entry, "injections": [*of_sequences, *injections]})


def sources(path: Path) -> tuple[Path, ...]:
    """Return a campaign file and those that it extends, one on top of the other; `load` must accept it."""
    content = documents.toml(path, "a campaign file")
    return (path, *(sources(path.parent / content["extends"]) if "extends" in content else ()))


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


def _spacecraft_model(name: object) -> SpacecraftModel:
    models = registered()
    if name not in models:
        raise InputError(f"spacecraft: no spacecraft {quote(name)}{closest_match(str(name), models)}")
    return models[str(name)]


def _table(raw: object, place: str) -> dict[str, Any]:
    if not isinstance(raw, dict):
        raise InputError(f"{place}: expected a table of keys and values")
    return raw


def _load_extended(path: Path, extending: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return what a file says, on top of what it extends; FMUs by their path as seen from the file."""
    raw = documents.toml(path, "a campaign file")
    schema = raw.get("schema", None if "extends" not in raw else SCHEMA)
    if schema == "lpf-campaign/1" or "actuation" in raw or isinstance(raw.get("spacecraft"), dict):
        raise InputError(f"{path}: {_CONVERSION}")
    if schema != SCHEMA:
        raise InputError(
            f'{path}: schema: {quote(schema) if schema else "missing"}, write schema = "{SCHEMA}"'
        )
    fmus = raw.get("fmus")
    for entry in fmus.values() if isinstance(fmus, dict) else ():
        if isinstance(entry, dict) and isinstance(entry.get("path"), str) and entry["path"]:
            entry["path"] = str(path.parent / entry["path"])
    if "extends" not in raw:
        return raw
    base = raw["extends"]
    beneath = path.parent / base if isinstance(base, str) and base and "\0" not in base else None
    if beneath is None or not _is_file(beneath):
        raise InputError(f"{path}: extends: {quote(base)}: no such file")
    chain = (*extending, path.resolve())
    if beneath.resolve() in chain:
        raise InputError(f"{path}: extends: {quote(base)} extends this file in turn")
    if len(chain) > _LONGEST_CHAIN:
        raise InputError(f"{path}: extends: more than {_LONGEST_CHAIN} files, one on top of the other")
    return _deep_merge(_load_extended(beneath, chain), raw)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that no file can have
        return False


def _deep_merge(base: dict[str, Any], overrides: dict[str, Any]) -> dict[str, Any]:
    """Add to the tables of `base`; values and lists are replaced."""
    merged = base | overrides
    for key, value in overrides.items():
        if isinstance(value, dict) and isinstance(base.get(key), dict):
            merged[key] = _deep_merge(base[key], value)
    return merged


def _swept(tables: dict[str, Any]) -> dict[str, Any]:
    """Return the tables with the experiments of a sweep instead: the first one for each of its authorities.

    Raises
    ------
    InputError
        If there are no lists of authorities of one length, or nothing to repeat.
    """
    if "sweep" not in tables:
        return tables
    lists = _table(tables["sweep"], "sweep")
    lengths = {len(values) if isinstance(values, list) else 0 for values in lists.values()}
    if len(lengths) != 1 or min(lengths) < 2:
        raise InputError(
            'sweep: expected lists of authorities of one length, such as F_max_2 = ["50 pN", "2200 pN"]'
        )
    if not isinstance(tables.get("experiments"), list) or not tables["experiments"]:
        raise InputError("experiments: missing, expected one to repeat in the sweep")
    template = {
        **_table(tables.get("defaults", {}), "defaults"),
        **_table(tables["experiments"][0], "experiments[0]"),
    }
    base = _table(tables.get("authority", {}), "authority").get(str(template.get("authority")), {})
    varying = [key for key, values in lists.items() if len(set(map(str, values))) > 1]
    experiments, authority = [], {}
    for n, values in enumerate(zip(*lists.values(), strict=True)):
        limits = dict(zip(lists, values, strict=True))
        name = "_".join(f"{key}-{limits[key]}".replace(" ", "") for key in varying)
        name = name if 0 < len(name) <= 57 else f"sweep-{n + 1}"  # leaves room for the name of the noise run
        authority[name] = {**base, **limits}
        experiment = template if n == 0 else {key: value for key, value in template.items() if key != "t0"}
        experiments.append({**experiment, "name": name, "authority": name})
    return {key: value for key, value in tables.items() if key != "sweep"} | {
        "experiments": experiments,
        "authority": authority,
    }


def _check_replacements(campaign: Campaign) -> None:
    """Refuse an FMU for a place that the loop does not have, and names that its place does not have."""
    if not campaign.fmus:
        return
    run = replace(campaign.runs[0], replacements=())
    parameters = campaign.model.parameters(run)
    places = {c.model: c for c in campaign.model.components(run)}
    for model, entry in campaign.fmus.items():
        if model not in places:
            match = closest_match(model, places)
            raise InputError(f"fmus.{model}: the loop of this campaign has no such place{match}")
        if not _is_file(entry.path):
            raise InputError(f"fmus.{model}.path: {quote(str(entry.path))}: no such file")
        _check_names(entry, list(places[model].inputs), list(places[model].outputs), parameters[model])


def _check_names(
    entry: Replacement, inputs: list[str], outputs: list[str], parameters: Mapping[str, float]
) -> None:
    place, settable = f"fmus.{entry.model}", [*inputs, *parameters]
    for name in entry.variables:
        if name not in (*settable, *outputs):
            match = closest_match(name, [*settable, *outputs])
            raise InputError(f"{place}.variables: no variable {quote(name)}{match}")
    for name in entry.unused:
        if name not in settable:
            raise InputError(
                f"{place}.unused: no input or parameter {quote(name)}{closest_match(name, settable)}"
            )
        if name in entry.variables:
            raise InputError(f"{place}.unused: {quote(name)} has a place under variables too")
    fed: dict[str, str] = {}
    for name in (*inputs, *(n for n in parameters if n in entry.variables)):
        variable = entry.variables.get(name, name)
        if name not in entry.unused and fed.setdefault(variable, name) != name:
            raise InputError(
                f"{place}.variables: {quote(variable)} stands for {fed[variable]} and for {name}"
            )
    for name in entry.values:
        if name in entry.variables.values() or (name in parameters and name not in entry.unused):
            raise InputError(f"{place}.values: {quote(name)} is set by the campaign already")
