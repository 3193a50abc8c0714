"""FMUs and stepping loop that come ready made with a wheel; they count while their sources are unchanged."""

from __future__ import annotations

import hashlib
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "prebuilt"
_MANIFEST = "manifest.json"


class UnfitError(Exception):
    """What is asked for is not there ready made; the message says why."""


@dataclass(frozen=True)
class Kind:
    """Platforms that a kind of file (``fmi2``, ``fmi3``, ``engine``) is made for, and sources by name."""

    platforms: Sequence[str]
    sources: Mapping[str, Path]


def write(folder: Path, kinds: Mapping[str, Kind], tools: Sequence[str]) -> None:
    """Write the manifest of ``folder``, which holds one folder for each kind; ``tools`` is for the reader."""
    entries = {
        name: {
            "platforms": list(kind.platforms),
            "sources": {key: _sha256(file) for key, file in kind.sources.items()},
            "files": {file.name: _sha256(file) for file in sorted((folder / name).iterdir())},
        }
        for name, kind in kinds.items()
    }
    text = json.dumps({"tools": list(tools), **entries}, indent=1)
    (folder / _MANIFEST).write_text(text + "\n", encoding="utf-8")


def find(kind: str, names: Sequence[str], sources: Mapping[str, Path]) -> list[Path]:
    """Return files that came with the package.

    Parameters
    ----------
    kind : str
        ``fmi2``, ``fmi3`` or ``engine``.
    names : sequence of str
        Names of files of that kind.
    sources : mapping of str to Path
        What such files are made from, here and now.

    Raises
    ------
    UnfitError
        If there are none, or not for this platform, or they or their sources have changed.
    """
    manifest = FOLDER / _MANIFEST
    try:
        entry = json.loads(manifest.read_text(encoding="utf-8"))[kind]
        platforms, recorded, files = entry["platforms"], entry["sources"], entry["files"]
    except FileNotFoundError:
        raise UnfitError("this installation came without compiled files") from None
    except (OSError, ValueError, KeyError, TypeError):
        raise UnfitError(f"{manifest} is damaged") from None
    if here() not in platforms:
        raise UnfitError(f"this installation came without compiled files ({kind}) for {here()}")
    for name in sorted({*sources, *recorded}):
        if name not in sources or recorded.get(name) != _sha256(sources[name]):
            place = sources.get(name, name)
            raise UnfitError(f"{place} has changed since the compiled files of this installation were made")
    for name in names:
        file = FOLDER / kind / name
        if not file.is_file() or files.get(name) != _sha256(file):
            raise UnfitError(f"{file} is missing or damaged")
    return [FOLDER / kind / name for name in names]


def here() -> str:
    """Name this platform as FMI 3.0 does; on Linux, another C library than glibc makes it another one."""
    import fmpy

    name = str(fmpy.platform_tuple)
    other = sys.platform == "linux" and platform.libc_ver()[0] != "glibc"
    return f"{name} without glibc" if other else name


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
