"""A folder of results: one process at a time works in it, and what it holds lets anybody make it again.

That is the campaign, with whatever it extends, and the FMUs that are not ours.
"""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import tomlkit
from filelock import FileLock, Timeout

from fit.files import is_file, refuse_links
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


def default(path: Path, suffix: str = "fit") -> Path:
    """Return the folder for results that is named after their input, never that of the input itself."""
    name = path.resolve().stem if is_file(path) else path.resolve().name
    folder = Path(name)
    return Path(f"{name}-{suffix}") if folder.exists() and folder.resolve() == path.resolve() else folder


def check_folder(directory: Path) -> None:
    """Refuse a folder for results that is a link or cannot be made; to be called before any work is done."""
    refuse_links(directory)
    existing = next((path for path in (directory, *directory.parents) if os.path.lexists(path)), Path())
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(f"{directory}: cannot be made in or written to, expected a folder for the results")


def check_file(path: Path, inputs: Iterable[Path] = (), suffixes: Sequence[str] = ()) -> None:
    """Refuse a file that cannot be written, or is an input; to be called before any work is done.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    inputs : iterable of Path
        Files that are read.
    suffixes : sequence of str
        How its name may end, such as ``.toml``; without any as it likes.

    Raises
    ------
    InputError
        If its name ends otherwise, it is a folder or an input, or its folder may not be written to.
    """
    if suffixes and path.suffix not in suffixes:
        raise InputError(f"{path}: expected a name that ends in {', '.join(suffixes)}")
    if path.is_dir() or not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: cannot be written, expected the name of a file in an existing folder")
    if path.resolve() in {input_path.resolve() for input_path in inputs}:
        raise InputError(f"{path}: is read by this command, expected another name")
