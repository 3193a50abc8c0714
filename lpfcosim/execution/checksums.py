"""Files that appear complete or not at all, and their checksums."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from fit.files import atomic
from lpfcosim.errors import RunError, as_run_error

_SCRATCH = ".lpfcosim-"


def write(path: Path, content: str | bytes) -> None:
    """Replace a file in one step; RunError if that fails, and the file before is unchanged."""
    with as_run_error():
        atomic.write(path, content)


def remove_temporary(folder: Path) -> None:
    """Remove unfinished and temporary files of all processes in ``folder``."""
    remove_partial(folder)
    for place in folder.glob(f"{_SCRATCH}*"):
        shutil.rmtree(place, ignore_errors=True)


def remove_partial(folder: Path) -> None:
    """Remove files in ``folder`` that a process did not finish."""
    for partial in folder.glob(f".*{atomic.suffix('*')}"):
        if partial.name.split(".")[-2].isdecimal():
            with suppress(OSError):
                partial.unlink()


@contextmanager
def temporary_folder(folder: Path) -> Iterator[Path]:
    """Make a folder for temporary files where `remove_temporary` finds it if this process is killed."""
    with tempfile.TemporaryDirectory(prefix=_SCRATCH, dir=folder, ignore_cleanup_errors=True) as place:
        yield Path(place).resolve()


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class PendingFile:
    """A file that is complete and has a temporary name.

    Attributes
    ----------
    partial : Path
        Where it is, in the folder where it will stay (`atomic.temporary`).
    digest : str
        SHA-256 of it.
    """

    partial: Path
    digest: str


class ChecksumFile:
    """The checksums of finished files, in the format of ``sha256sum``.

    Parameters
    ----------
    path : Path
        Of the checksum file. Files are named as seen from its folder; a line that names none does not count.
        What is there and cannot be read is an OSError: nobody knows what would be lost with it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._digests: dict[str, str] = {}
        with suppress(FileNotFoundError):
            for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
                recorded, _, name = line.partition("  ")
                self._digests[name] = recorded

    def matches(self, file: Path) -> bool | None:
        """Return whether a file has its recorded checksum; None if none is recorded."""
        recorded = self._digests.get(self._name(file))
        try:
            return None if recorded is None else digest(file) == recorded
        except FileNotFoundError:
            return False

    def add(self, file: Path, finished: PendingFile) -> None:
        """Record the checksum of a finished file, then give it its name, both on disk before this returns.

        In this order no file has its name without a checksum, whatever is killed in between.

        Raises
        ------
        RunError
            If checksums or file cannot be written.
        """
        self._digests[self._name(file)] = finished.digest
        try:
            self._write()
            atomic.settle(finished.partial, file)
        except OSError as error:
            raise RunError(f"{file}: cannot be written ({error.strerror or error})") from None
        finally:
            with suppress(OSError):
                finished.partial.unlink(missing_ok=True)

    def remove(self, files: Iterable[Path]) -> None:
        """Remove files, their checksums first."""
        files = list(files)
        for file in files:
            self._digests.pop(self._name(file), None)
        self._write()
        for file in files:
            file.unlink(missing_ok=True)

    def _write(self) -> None:
        write(self._path, "".join(f"{self._digests[name]}  {name}\n" for name in sorted(self._digests)))

    def _name(self, file: Path) -> str:
        return file.relative_to(self._path.parent).as_posix()
