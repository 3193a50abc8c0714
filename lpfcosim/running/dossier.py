"""What a folder of results holds so that anybody can make it again: the campaign and the FMUs not ours."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import tomli_w

from lpfcosim.campaign import campaign as campaigns
from lpfcosim.errors import InputError
from lpfcosim.running import ledger as files

CAMPAIGN = "campaign.toml"
_FMUS = "fmus"


def keep(directory: Path, campaign: Path, fmus: Mapping[str, Path]) -> None:
    """Write ``campaign.toml``, with whatever it extends, and ``fmus/MODEL.fmu`` for each of ``fmus``.

    Raises
    ------
    InputError
        If the campaign can no longer be read.
    """
    tables = campaigns.resolved(campaign)
    if fmus:
        (directory / _FMUS).mkdir(exist_ok=True)
    for model, archive in fmus.items():
        copy = directory / _FMUS / f"{model}.fmu"
        files.write(copy, archive.read_bytes())
        tables["fmus"][model] |= {"path": f"{_FMUS}/{copy.name}", "sha256": files.digest(archive)}
    files.write(directory / CAMPAIGN, tomli_w.dumps(tables))


def campaign_of(directory: Path) -> Path:
    """Return the campaign that a folder of results holds.

    Raises
    ------
    InputError
        If there is none.
    """
    path = directory / CAMPAIGN
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected the folder of an earlier run")
    return path
