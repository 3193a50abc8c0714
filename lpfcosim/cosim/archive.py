"""FMU archives from anywhere: size and description are looked at before anything is taken out of one."""

import zipfile
import zlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.parsers import expat

import fmpy
from fmpy.model_description import ValidationError

from lpfcosim.errors import InputError
from lpfcosim.messages import line

MAX_FILES = 10_000
MAX_SIZE = 2**30  # bytes, unpacked: `zipfile` takes out what is declared and no more
MAX_XML = 2**24  # bytes of a description, which is held in memory as a tree of ten times the size
_DESCRIPTION = "modelDescription.xml"
_PARSED = (_DESCRIPTION, "sources/buildDescription.xml")  # by FMPy


def describe(
    archive: Path, named: Path | None = None, *, validate: bool = True
) -> tuple[Any, tuple[str, ...]]:
    """Return FMPy's model description of an archive, and its faults against the FMI schema.

    Parameters
    ----------
    archive : Path
        The ``.fmu``.
    named : Path, optional
        What messages call it, if it is a copy.
    validate : bool
        Refuse one that is not valid, so that no fault remains.

    Raises
    ------
    InputError
        If it cannot be read, or is not valid and should be.
    """
    try:
        status = archive.stat()
    except OSError as error:
        raise InputError(f"{named or archive}: not a readable FMU: {error.strerror}") from None
    description, faults = _describe(archive, named or archive, status.st_mtime_ns, status.st_size)
    if faults and validate:
        raise InputError(
            f"{named or archive}: {nonconformity(faults)}; correct the archive, or accept it as it is with "
            "validate = false in its table [fmus.MODEL] of the campaign"
        )
    return description, faults


def nonconformity(faults: Sequence[str]) -> str:
    """Return one line about the faults of a description against the FMI schema."""
    suffix = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    return (
        f"its modelDescription.xml does not conform to the FMI schema: {line(faults[0]).rstrip('.')}{suffix}"
    )


@lru_cache(maxsize=32)
def _describe(archive: Path, named: Path, _changed: int, _size: int) -> tuple[Any, tuple[str, ...]]:
    _check(archive, named)
    try:
        return _read(archive, validate=True), ()
    except Exception as error:  # FMPy raises bare exceptions for broken archives
        fault = error
    try:
        description = _read(archive, validate=False)
        usable = all(v.name and v.type for v in description.modelVariables)
    except Exception:
        usable = False
    if not usable:
        raise InputError(f"{named}: not a readable FMU: {line(fault)}") from None
    # FMPy looks up the unit of a display unit
    undefined = f"the unit {fault} is not defined" if isinstance(fault, KeyError) else fault
    faults = fault.problems if isinstance(fault, ValidationError) else [undefined]
    return description, tuple(map(str, faults))


def _read(archive: Path, *, validate: bool) -> Any:
    with archive.open("rb") as file:  # by name, FMPy would leave open what it fails on
        return fmpy.read_model_description(file, validate=validate)


def _check(path: Path, named: Path) -> None:
    """Refuse what is no archive or too large, or has a description that declares a document type.

    The entities of a document type can read other files or grow without bound.
    """
    if not path.is_file():  # opening a pipe would wait for somebody to write
        raise InputError(f"{named}: not a readable FMU: {'not a file' if path.exists() else 'no such file'}")
    try:
        with zipfile.ZipFile(path) as archive:
            files = archive.infolist()
            size = sum(file.file_size for file in files)
            if len(files) > MAX_FILES or size > MAX_SIZE:
                limits = f"{MAX_FILES} files, {MAX_SIZE} bytes"
                raise InputError(
                    f"{named}: holds {len(files)} files, unpacks to {size} bytes; expected at most {limits}"
                )
            parsed = {file.filename for file in files if file.file_size <= MAX_XML} & {*_PARSED}
            contents = {name: archive.read(name) for name in parsed}
    except (OSError, zipfile.BadZipFile, zlib.error, EOFError, ValueError, RuntimeError) as error:
        raise InputError(f"{named}: not a readable FMU: {line(error)}") from None
    if _DESCRIPTION not in contents:
        raise InputError(f"{named}: expected a {_DESCRIPTION} of at most {MAX_XML} bytes")
    for name, content in contents.items():
        _check_xml(f"{named}: {name}", content)


def _check_xml(place: str, content: bytes) -> None:
    def refuse(*_: object) -> None:
        raise InputError(f"{place}: declares a document type, which could hold entities; expected none")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise InputError(f"{place}: not readable XML: {error}") from None


def check_platform(archive: Path, description: Any, named: Path) -> None:
    """Refuse an archive without a binary for this platform."""
    platform = fmpy.platform if description.fmiVersion.startswith("2") else fmpy.platform_tuple
    with zipfile.ZipFile(archive) as file:
        names = file.namelist()
    identifier = description.coSimulation.modelIdentifier
    if f"binaries/{platform}/{identifier}{fmpy.sharedLibraryExtension}" in names:
        return
    platforms = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") > 1})
    binaries = f"has a binary for {', '.join(platforms)} only" if platforms else "has no binary"
    sources = any(name.startswith("sources/") and name.endswith(".c") for name in names)
    remedy = f"; fmpy compile {named} makes one of its sources" if sources else ""
    raise InputError(f"{named}: {binaries}; expected one for {platform}{remedy}")
