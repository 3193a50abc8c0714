"""A folder of results: one process at a time works in it, and what it holds lets anybody make it again.

That is the campaign, with whatever it extends, and the FMUs that are not ours.
"""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import tomlkit
from filelock import FileLock, Timeout

from fit.files import refuse_links
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import checksums

CAMPAIGN = "campaign.toml"
_FMUS = "fmus"
_LOCK, _HOLDER = ".lock", ".lock-holder"
_FOLDERS = ("telemetry", "figures", _FMUS)


@contextmanager
def lock(directory: Path, *, alternative: bool = False) -> Iterator[None]:
    """Make a folder of results if need be, keep other processes out of it, and clear what dead ones left.

    The operating system lets go of the lock when its holder ends, however it ends. Files that a process did
    not finish have a name of their own (`atomic.temporary`); once the lock is held, nobody alive writes them.
    Within a process it may be held again while it is held. `alternative` says that the caller can choose
    another folder.

    Raises
    ------
    InputError
        If another process works in the folder, which is named, or it is a file, or a link leads elsewhere, or
        there can be none of its name.
    RunError
        If the folder cannot be locked, or made as the disk is full.
    """
    refuse_links(directory)
    holder = directory / _HOLDER
    try:
        directory.mkdir(parents=True, exist_ok=True)
        lock = FileLock(directory.resolve() / _LOCK, timeout=0, is_singleton=True)
        inside = lock.is_locked
        acquired = lock.acquire()
    except Timeout:
        who = ""
        with suppress(OSError):
            who = f" ({holder.read_text(encoding='utf-8').strip()})"
        advice = "wait for it or choose another folder" if alternative else "wait for it"
        raise InputError(f"{directory}: another process works in it{who}; {advice}") from None
    except OSError as error:
        kind = RunError if error.errno in (errno.ENOSPC, errno.EDQUOT) else InputError
        reason = error.strerror or error
        raise kind(
            f"{directory}: cannot be made or locked ({reason}), expected a folder for the results"
        ) from None
    with acquired:
        if inside:
            yield
            return
        for folder in (".", *_FOLDERS):
            checksums.remove_temporary(directory / folder)
        with suppress(OSError):
            holder.write_text(f"process {os.getpid()} on {socket.gethostname()}\n", encoding="utf-8")
        try:
            yield
        finally:
            with suppress(OSError):
                holder.unlink()


def write_provenance(directory: Path, content: Mapping[str, Any], fmus: Mapping[str, Path]) -> None:
    """Write ``campaign.toml``, and ``fmus/MODEL.fmu`` for each third-party FMU.

    Parameters
    ----------
    directory : Path
        The folder, locked.
    content : mapping
        The tables of the campaign, with those that it extends.
    fmus : mapping of str to Path
        Those FMUs by model.
    """
    tables = {**content}
    if fmus:
        (directory / _FMUS).mkdir(exist_ok=True)
        tables["fmus"] = {**content["fmus"]}
    for model, archive in fmus.items():
        copy = directory / _FMUS / f"{model}.fmu"
        checksums.write(copy, archive.read_bytes())
        tables["fmus"][model] = {**content["fmus"][model], "path": f"{_FMUS}/{copy.name}"}
    checksums.write(directory / CAMPAIGN, tomlkit.dumps(tables))
