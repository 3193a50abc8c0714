"""The FMUs of others that the user has approved: their digests, in the user's own configuration.

A list that lay beside a campaign, or in it, would be the word of whoever wrote the campaign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import tomlkit
from filelock import FileLock
from platformdirs import user_config_path
from pydantic import Field, Strict, ValidationError

from fit.errors import quote
from fit.files import Table, documents, validation_messages
from lpfcosim.cosim import archive
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import checksums

_SHORTEST = 8  # digits of a digest that name it
_Text = Annotated[str, Strict()]


@dataclass(frozen=True)
class Approval:
    """An FMU that may run.

    Attributes
    ----------
    sha256 : str
        Digest of the archive.
    name : str
        Of the file when it was approved; only for the reader.
    date : str
        When, ISO 8601.
    """

    sha256: str
    name: str
    date: str


class _Entry(Table):
    sha256: Annotated[str, Strict(), Field(pattern=r"^[0-9a-f]{64}$")]
    name: _Text
    date: _Text


class _List(Table):
    fmus: list[_Entry] = []


def location() -> Path:
    """Return the file with the approvals, which need not be there."""
    return user_config_path("lpfcosim") / "trusted.toml"


def approvals() -> list[Approval]:
    """Return what is approved, in the order of approval.

    Raises
    ------
    InputError
        If the file with the approvals cannot be read.
    """
    path = location()
    if not path.exists():
        return []
    raw = documents.toml(path, "the list of approved FMUs")
    try:
        return [Approval(**entry.model_dump()) for entry in _List.model_validate(raw).fmus]
    except ValidationError as error:
        raise InputError(f"{path}: {validation_messages(error)}") from None


def digests() -> set[str]:
    """Return the digests of what is approved; InputError as `approvals`."""
    return {approval.sha256 for approval in approvals()}


def approve(files: Sequence[Path]) -> list[Approval]:
    """Approve FMUs, all or none, and return the approvals; one that was approved before is as it was.

    Raises
    ------
    InputError
        If a file is no FMU archive, or the list cannot be read.
    RunError
        If the list cannot be written.
    """
    date = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    for file in files:
        archive.check(file)
    new_approvals = [Approval(checksums.digest(file), file.name, date) for file in files]
    with _lock():
        known = {approval.sha256: approval for approval in approvals()}
        for approval in new_approvals:
            known.setdefault(approval.sha256, approval)
        _write(list(known.values()))
    return [known[approval.sha256] for approval in new_approvals]


def revoke(names: Sequence[str]) -> list[Approval]:
    """Withdraw approvals, all or none, and return them.

    Parameters
    ----------
    names : sequence of str
        Each a file, or the first eight or more digits of a digest: files change, and go.

    Raises
    ------
    InputError
        If one names no approved FMU, or the list cannot be read.
    RunError
        If the list cannot be written.
    """
    with _lock():
        known = approvals()
        revoked: list[Approval] = []
        for name in names:
            path = Path(name)
            digest = checksums.digest(path) if documents.is_file(path) else name.lower()
            matches = [a for a in known if len(digest) >= _SHORTEST and a.sha256.startswith(digest)]
            if not matches:
                raise InputError(
                    f"{quote(name)}: not among the approved FMUs, expected one of them or "
                    f"{_SHORTEST} digits or more of its digest (lpfcosim trust lists them)"
                )
            revoked += matches
        _write([approval for approval in known if approval not in revoked])
    return revoked


def _lock() -> FileLock:
    """Return the lock under which the list is changed, so that no change is lost."""
    path = location()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"{path.parent}: cannot be made ({error.strerror})") from None
    return FileLock(path.with_suffix(".lock"))


def _write(remaining: Sequence[Approval]) -> None:
    checksums.write(
        location().resolve(), tomlkit.dumps({"fmus": [asdict(approval) for approval in remaining]})
    )
