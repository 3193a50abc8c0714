"""One process at a time on a folder of results."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from lpfcosim.errors import InputError, RunError
from lpfcosim.running import ledger as files

_LOCK, _HOLDER = ".lock", ".lock-holder"
_FOLDERS = ("telemetry", "figures", "fmus")


@contextmanager
def held(directory: Path) -> Iterator[None]:
    """Make a folder of results if need be, keep other processes out of it, and clear what dead ones left.

    The operating system lets go of the lock when its holder ends, however it ends. Files that a process did
    not finish have a name of their own (`files.temporary`); once the lock is held, nobody alive writes them.
    Within a process it may be held again while it is held.

    Raises
    ------
    InputError
        If another process works in the folder, which is named, or it is a file.
    RunError
        If the folder cannot be made or locked.
    """
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
        told = f"{directory}: another process works in it{who}; wait for it or choose another --out"
        raise InputError(told) from None
    except (FileExistsError, NotADirectoryError):
        told = f"{directory}: is a file or lies in one, expected a folder for the results"
        raise InputError(told) from None
    except OSError as error:
        raise RunError(f"{directory}: cannot be locked: {error.strerror or error}") from None
    with acquired:
        if inside:
            yield
            return
        for folder in (".", *_FOLDERS):
            files.discard_all(directory / folder)
        with suppress(OSError):
            holder.write_text(f"process {os.getpid()} on {socket.gethostname()}\n", encoding="utf-8")
        try:
            yield
        finally:
            with suppress(OSError):
                holder.unlink()
