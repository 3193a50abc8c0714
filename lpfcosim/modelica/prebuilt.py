"""Compiled FMUs and stepping loop shipped in a wheel; valid while their sources are unchanged."""

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


class StalePrebuiltError(Exception):
    """The wheel has no valid prebuilt file; the message gives the reason."""


@dataclass(frozen=True)
class PrebuiltGroup:
    """Platforms of a group of files (``fmi2``, ``fmi3``, ``engine``), and its sources by name.

    Without platforms the files (``numpy``) are for all of them.
    """

    platforms: Sequence[str]
    sources: Mapping[str, Path]


def write(folder: Path, groups: Mapping[str, PrebuiltGroup], tools: Sequence[str]) -> None:
    """Write the manifest of ``folder``, which holds one folder for each group; ``tools`` is informative."""
    entries = {
        name: {
            "platforms": list(group.platforms),
            "sources": {key: _sha256(file) for key, file in group.sources.items()},
            "files": {file.name: _sha256(file) for file in sorted((folder / name).iterdir())},
        }
        for name, group in groups.items()
    }
    text = json.dumps({"tools": list(tools), **entries}, indent=1)
    (folder / _MANIFEST).write_text(text + "\n", encoding="utf-8")


def find(group: str, names: Sequence[str], sources: Mapping[str, Path]) -> list[Path]:
    """Return files that came with the package.

    Parameters
    ----------
    group : str
        ``fmi2``, ``fmi3``, ``engine`` or ``numpy``.
    names : sequence of str
        File names in that group.
    sources : mapping of str to Path
        Current sources of such files.

    Raises
    ------
    StalePrebuiltError
        If there are none, or not for this platform, or they or their sources have changed.
    """
    manifest = FOLDER / _MANIFEST
    try:
        entry = json.loads(manifest.read_text(encoding="utf-8"))[group]
        platforms, recorded, files = entry["platforms"], entry["sources"], entry["files"]
    except FileNotFoundError:
        raise StalePrebuiltError("this installation came without compiled files") from None
    except (OSError, ValueError, KeyError, TypeError):
        raise StalePrebuiltError(f"{manifest} is damaged") from None
    if platforms and platform_name() not in platforms:
        raise StalePrebuiltError(
            f"this installation came without compiled files ({group}) for {platform_name()}"
        )
    for name in sorted({*sources, *recorded}):
        if name not in sources or recorded.get(name) != _sha256(sources[name]):
            place = sources.get(name, name)
            raise StalePrebuiltError(
                f"{place} has changed since the compiled files of this installation were made"
            )
    for name in names:
        file = FOLDER / group / name
        if not file.is_file() or files.get(name) != _sha256(file):
            raise StalePrebuiltError(f"{file} is missing or damaged")
    return [FOLDER / group / name for name in names]


def platform_name() -> str:
    """Name this platform as FMI 3.0 does; on Linux, another C library than glibc makes it another one."""
    import fmpy

    name = str(fmpy.platform_tuple)
    if sys.platform == "linux" and platform.libc_ver()[0] != "glibc":
        return f"{name} without glibc"
    return name


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
