"""The campaign of a workflow, given as such or as the path of its file."""

import os
from collections.abc import Iterable
from pathlib import Path

from pydantic import ValidationError

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


def is_described_by_file(campaign: Campaign) -> bool:
    """Return whether a campaign is still as its file has it; it may have been changed in Python."""
    try:
        return loading.validated(campaign.tables) == campaign
    except (InputError, ValidationError):  # a campaign without a file
        return False


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
