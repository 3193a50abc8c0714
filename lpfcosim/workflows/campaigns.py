"""The campaign of a workflow, given as such or as the path of its file."""

import os
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import tomlkit

from fit.errors import shown
from lpfcosim.campaign import Campaign, loading
from lpfcosim.errors import InputError

PathLike = str | os.PathLike[str]
CampaignLike = Campaign | PathLike


def load_campaign(path: PathLike) -> Campaign:
    """Read a campaign.

    Raises
    ------
    InputError
        If the file cannot be read or is not a valid campaign. The message gives the place in the file.
    """
    return loading.load(as_path(path, "a campaign file"))


def resolve(campaign: CampaignLike) -> tuple[Campaign, Path | None]:
    """Return a campaign, and its file if it was given as a path.

    Raises
    ------
    InputError
        As `load_campaign`, or if it is neither a campaign nor a path.
    """
    if isinstance(campaign, Campaign):
        return campaign, None
    path = as_path(campaign, "a Campaign, or the path of its file")
    return loading.load(path), path


def is_described_by_file(campaign: Campaign, fmus: Mapping[str, Path] | None = None) -> bool:
    """Return whether a campaign is still as its file has it.

    Parameters
    ----------
    campaign : Campaign
        It may have been changed in Python, or have no file.
    fmus : mapping of str to Path, optional
        Its third-party FMUs by model, wherever they lie now.
    """
    archives = {model: {"path": str(path.resolve())} for model, path in (fmus or {}).items()}
    tables = {**campaign.tables}
    entries = tables.get("fmus", {})
    if not archives.keys() <= entries.keys():
        return False
    if archives:
        tables["fmus"] = {model: {**entry, **archives.get(model, {})} for model, entry in entries.items()}
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        path = Path(folder) / "campaign.toml"
        path.write_text(tomlkit.dumps(tables), encoding="utf-8")
        try:
            described = loading.load(path)
        except InputError:  # a campaign without a file
            return False
    # An FMU may lie elsewhere: of the replacements the digest has the rest.
    is_equal = replace(described, fmus=campaign.fmus) == campaign
    return is_equal and described.digest == campaign.digest


def as_paths(paths: object, expected: str) -> list[Path]:
    """Return one path or several as a list; InputError for what is none, with what was expected."""
    if isinstance(paths, Iterable) and not isinstance(paths, str | bytes):
        return [as_path(path, expected) for path in paths]
    return [as_path(paths, expected)]


def as_path(path: object, expected: str) -> Path:
    """Return a path; InputError if it is none, with what was expected."""
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{shown(path)}: expected {expected}")
    text = os.fsdecode(path)
    if "\0" in text:
        raise InputError(f"{shown(path)}: expected {expected}, without NUL")
    return Path(text)
