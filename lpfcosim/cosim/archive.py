"""FMU archives from anywhere: what one holds is looked at before anything is taken out of it."""

from __future__ import annotations

import stat
import unicodedata
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from xml.parsers import expat

from lpfcosim.errors import InputError
from lpfcosim.messages import line

MAX_FILES = 10_000
MAX_SIZE = 2**30  # bytes, unpacked
MAX_XML = 2**24  # bytes of a description, which is held in memory as a tree of ten times the size
MAX_NAME = 255  # bytes, what file systems take
_DESCRIPTION = "modelDescription.xml"
#: What FMPy and the FMU manipulation toolbox parse.
_PARSED = (_DESCRIPTION, "sources/buildDescription.xml", "terminalsAndIcons/terminalsAndIcons.xml")
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # all that FMI allows; the others know no bounds
_ENCRYPTED = 0x1


def check(path: Path, named: Path | None = None) -> None:
    """Refuse an archive that could do harm when it is unpacked or its description parsed.

    Every file must have a name of its own inside the archive's folder, be neither a link nor encrypted, and
    all together must not unpack to more than `MAX_SIZE`: `zipfile` takes out what is declared and no more. A
    description must not declare entities, which can read other files or grow without bound. Messages
    call it `named`, if `path` is a copy.

    Raises
    ------
    InputError
        If it is such an archive, or none at all.
    """
    place = named or path
    if not path.is_file():  # opening a pipe would wait for somebody to write
        raise InputError(f"{place}: not a readable FMU: {'not a file' if path.exists() else 'no such file'}")
    with _readable(place):
        archive = zipfile.ZipFile(path)
    with archive:
        _check_files(place, archive.infolist())
        names = archive.namelist()
        if _DESCRIPTION not in names:
            raise InputError(f"{place}: has no {_DESCRIPTION}; expected one")
        for name in [name for name in _PARSED if name in names]:
            with _readable(place):
                content = archive.read(name)
            _check_xml(f"{place}: {name}", content)


@contextmanager
def _readable(place: Path) -> Iterator[None]:
    """Refuse what `zipfile` cannot read; damage shows as any of these errors."""
    try:
        yield
    except (OSError, zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError) as error:
        raise InputError(f"{place}: not a readable FMU: {line(error)}") from None


def _check_files(path: Path, files: Sequence[zipfile.ZipInfo]) -> None:
    if len(files) > MAX_FILES:
        raise InputError(f"{path}: holds {len(files)} files; expected at most {MAX_FILES}")
    size = sum(file.file_size for file in files)
    if size > MAX_SIZE:
        raise InputError(f"{path}: unpacks to {size} bytes; expected at most {MAX_SIZE}")
    is_folder: dict[str, bool] = {}  # whether it is a folder, by its name where letters have no case
    for file in files:
        place = f"{path}: {file.orig_filename[:80]!a}"
        path_parts = PurePosixPath(file.filename).parts
        # A folder that does not exist yet leads nowhere, but ".." out of it leads anywhere.
        if (
            not path_parts
            or ".." in path_parts
            or file.filename.startswith("/")
            or file.filename != file.orig_filename  # cut at a NUL
            or any(c in '\\:*?"<>|' or ord(c) < 32 or 0xD800 <= ord(c) < 0xE000 for c in file.filename)
            or max(len(part.encode()) for part in path_parts) > MAX_NAME
            or len(file.filename.encode()) > 4 * MAX_NAME
        ):
            raise InputError(f"{place}: expected a file name inside the archive")
        if stat.S_ISLNK(file.external_attr >> 16):
            raise InputError(f"{place}: is a symbolic link; expected a file")
        if file.flag_bits & _ENCRYPTED:
            raise InputError(f"{place}: is encrypted; expected a file that can be read")
        if file.compress_type not in _METHODS:
            raise InputError(f"{place}: is compressed by method {file.compress_type}; expected deflate")
        if file.filename == _DESCRIPTION and file.file_size > MAX_XML:
            raise InputError(f"{place}: has {file.file_size} bytes; expected at most {MAX_XML}")
        key = unicodedata.normalize("NFC", "/".join(path_parts)).casefold()
        parents = ["/".join(key.split("/")[:n]) for n in range(1, len(path_parts))]
        if any(is_folder.setdefault(folder, True) is False for folder in parents):
            raise InputError(f"{place}: lies in a file; expected a folder")
        if key in is_folder and not (is_folder[key] and file.is_dir()):
            raise InputError(f"{place}: occurs twice; expected once")
        is_folder[key] = file.is_dir()


def _check_xml(place: str, content: bytes) -> None:
    """Refuse what is no XML, or has a document type, the place where entities are declared."""
    if len(content) > MAX_XML:
        raise InputError(f"{place}: has {len(content)} bytes; expected at most {MAX_XML}")

    def refuse(*_: object) -> None:
        raise InputError(f"{place}: declares a document type, which could hold entities; expected none")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise InputError(f"{place}: not readable XML: {error}") from None
