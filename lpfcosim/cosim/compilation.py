"""The binary of an FMU for this platform: in its archive, or compiled from the sources in it."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import fmpy

from fit.errors import quote
from lpfcosim.cosim.interface import describe
from lpfcosim.errors import InputError, RunError
from lpfcosim.messages import line
from lpfcosim.modelica import build, compiler

_SOURCES = "sources/"
_HEADERS = Path(fmpy.__file__).parent / "c-code"  # of FMI 2 and 3
# Functions named as in a shared library, also by sources that give them a prefix for static linking.
_NAMES = ("-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-DFMI3_OVERRIDE_FUNCTION_PREFIX")
_FLAGS = ("-O2", "-fPIC", "-ffp-contract=off", "-w", *_NAMES)
_OPTIONS = {"C89": "-std=gnu89", "C90": "-std=gnu90", "C99": "-std=gnu99", "C11": "-std=gnu11"}
_OPTIONS |= {"C17": "-std=gnu17", "C23": "-std=gnu2x"}
_OPTIONS |= {f"C++{year}": f"-std=gnu++{year}" for year in ("98", "11", "14", "17", "20", "23", "26")}
_PLUS = (".cpp", ".cc", ".cxx")
_MATH = () if os.name == "nt" else ("-lm",)
_TIME_LIMIT = 600.0  # s, of a compilation


def platform(description: Any) -> str:
    """Return the folder of binaries for this platform, which depends on the version of FMI."""
    return str(fmpy.platform if description.fmiVersion.startswith("2") else fmpy.platform_tuple)


def library(description: Any) -> str:
    """Return the place in an archive of the binary for this platform."""
    identifier = description.coSimulation.modelIdentifier
    return f"binaries/{platform(description)}/{identifier}{fmpy.sharedLibraryExtension}"


def has_binary(archive: Path, description: Any) -> bool:
    """Return whether an archive has a binary for this platform."""
    return library(description) in _names(archive, archive)


def _names(archive: Path, named: Path) -> list[str]:
    try:
        with zipfile.ZipFile(archive) as file:
            return file.namelist()
    except (OSError, zipfile.BadZipFile) as error:
        raise InputError(f"{named}: not a readable FMU: {line(error)}") from None


def check_platform(archive: Path, description: Any, named: Path) -> None:
    """Refuse an archive that has neither a binary for this platform nor sources in C or C++ that make one.

    Raises
    ------
    InputError
        With the platforms that it has binaries for.
    """
    names = _names(archive, named)
    if library(description) in names or _file_sets(description):
        for files in () if library(description) in names else _file_sets(description):
            _check_language(files, names, named)
        return
    platforms = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") > 1})
    binaries = f"has a binary for {', '.join(platforms)} only" if platforms else "has no binary"
    unlisted = any(n.startswith(_SOURCES) and n.endswith(".c") for n in names)
    also = ", and its description lists no source files to compile" if unlisted else ""
    raise InputError(f"{named}: {binaries}{also}; expected one for {platform(description)}")


def _file_sets(description: Any) -> list[Any]:
    """Return the sets of source files of the co-simulation part of an FMU."""
    configurations: list[Any] = description.buildConfigurations
    if len(configurations) > 1:  # a single one is meant, whatever it is called
        identifier = description.coSimulation.modelIdentifier
        configurations = [c for c in configurations if c.modelIdentifier == identifier]
    return [files for c in configurations[:1] for files in c.sourceFileSets if files.sourceFiles]


def _check_language(files: Any, names: Sequence[str], named: Path) -> None:
    unknown_files = [f for f in files.sourceFiles if not f.endswith((".c", *_PLUS))]
    if unknown_files or (files.language or "C99") not in _OPTIONS:
        description = quote(unknown_files[0]) if unknown_files else f"language {quote(files.language)}"
        raise InputError(
            f"{named}: has no binary for this platform, and sources: {description}; expected C or C++"
        )
    for file in files.sourceFiles:
        if f"{_SOURCES}{file}" not in names:
            raise InputError(f"{named}: {_SOURCES}{file}: is missing, which its description lists")


def prepare(archive: Path, named: Path, *, validate: bool) -> None:
    """Compile an FMU that may run and has no binary for this platform, so that no run waits or fails for it.

    Raises
    ------
    InputError, RunError
        As `compiled`, and if the archive cannot be read.
    """
    description, _ = describe(archive, named, validate=validate)
    if description.coSimulation is not None and not has_binary(archive, description):
        check_platform(archive, description, named)
        compiled(archive, description, named)


def compiled(archive: Path, description: Any, named: Path) -> Path:
    """Return the binary made of the sources of an archive, compiled once and kept in the user's cache.

    To compile the sources of an FMU is the first step to run its code: only for one that may run.

    Raises
    ------
    InputError
        If there is no compiler, or the sources do not compile; the message names the log.
    RunError
        If the cache cannot be written.
    """
    try:
        chosen = compiler.compiler()
    except InputError as error:
        raise InputError(
            f"{named}: has sources but no binary for {platform(description)}, and {error}"
        ) from None
    with archive.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    folder = build.cache_directory() / "compiled" / _key(digest, description, chosen, named)
    binary = folder / Path(library(description)).name
    if not binary.is_file():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _compile(archive, description, named, chosen, binary)
        except OSError as error:
            raise RunError(f"{named}: cannot be compiled in {folder}: {error.strerror or error}") from None
    return binary


def _key(digest: str, description: Any, chosen: compiler.Compiler, named: Path) -> str:
    """Return the cache key of a binary: of all that it is compiled from and with."""
    sources = [name for files in _file_sets(description) for name in files.sourceFiles]
    key_parts = [digest, chosen.version, platform(description), *_FLAGS, *map(str, _OPTIONS.items()), *_MATH]
    if any(name.endswith(_PLUS) for name in sources):
        key_parts += _plus(chosen, named)
    for header in sorted(_HEADERS.glob("*.h")):
        key_parts += [header.name, hashlib.sha256(header.read_bytes()).hexdigest()]
    return hashlib.sha256("\0".join(key_parts).encode()).hexdigest()[:16]


def _compile(archive: Path, description: Any, named: Path, chosen: compiler.Compiler, binary: Path) -> None:
    """Compile every set of files with its own language and definitions, and link them."""
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as place:
        root = Path(place)
        with zipfile.ZipFile(archive) as file:
            file.extractall(root, [n for n in file.namelist() if n.startswith(_SOURCES)])
        sources, objects, messages = root / _SOURCES, list[str](), list[str]()
        failed = False
        linker = chosen.command
        for files in _file_sets(description):
            options = [_OPTIONS[files.language]] if files.language else []
            options += [
                f"-D{d.name}={d.value}" if d.value else f"-D{d.name}" for d in files.preprocessorDefinitions
            ]
            places = [sources, *(sources / name for name in files.includeDirectories), _HEADERS]
            options += [f"-I{place}" for place in places]
            for name in files.sourceFiles:
                target = root / f"{len(objects)}.o"
                command = _plus(chosen, named) if name.endswith(_PLUS) else chosen.command
                linker = command if name.endswith(_PLUS) else linker
                unit = ["-c", str(sources / name), "-o", str(target)]
                failed |= _call([*command, *_FLAGS, *options, *unit], sources, messages)
                objects.append(str(target))
        target = root / binary.name
        link = ["-shared", *objects, "-o", str(target), *_MATH]
        failed = failed or _call([*linker, *_FLAGS, *link], root, messages)
        if failed:
            log = binary.with_suffix(".log")
            log.write_text("\n".join(messages), encoding="utf-8")
            fault = next(
                (text for text in "\n".join(messages).splitlines() if "error" in text), "the compiler fails"
            )
            fault = fault.replace(f"{sources}{os.sep}", _SOURCES)
            raise InputError(
                f"{named}: its sources do not compile with {chosen.version}: {line(fault)}; see {log}"
            )
        partial = binary.with_name(f"{binary.name}.{os.getpid()}.part")
        shutil.copyfile(target, partial)
        partial.replace(binary)


def _plus(chosen: compiler.Compiler, named: Path) -> tuple[str, ...]:
    """Return the command of the compiler for C++ that goes with one for C."""
    if "ziglang" in chosen.command:
        return (*chosen.command[:-1], "c++")
    candidates = [tuple(os.environ.get("CXX", "").split()), ("c++",), ("g++",), ("clang++",)]
    for command in candidates:
        if command and shutil.which(command[0]):
            return command
    raise InputError(f"{named}: has sources in C++, and no compiler was found; install one, or set CXX")


def _call(command: Sequence[str], folder: Path, messages: list[str]) -> bool:
    """Call a compiler, note what it says, and return whether it failed."""
    messages.append(" ".join(command))
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=_TIME_LIMIT,
        )
    except subprocess.TimeoutExpired:
        messages.append(f"error: not compiled within {_TIME_LIMIT:g} s")
        return True
    messages.append(done.stdout + done.stderr)
    return done.returncode != 0
