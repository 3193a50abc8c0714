"""The Modelica source files of a package, and where something stands in them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

_USES = re.compile(r"\buses\s*\(([^;]*)\)")
_LIBRARY = re.compile(r"(\w+)\s*\(\s*version\b")

Node = dict[str, Any]  # of the tree that the front end gives


def package_files(package: Path) -> list[Path]:
    """All Modelica sources of a package folder and of the libraries it uses, or the one file given."""
    if not package.is_dir():
        return [package]
    return [file for folder in (package, *used_libraries(package)) for file in sorted(folder.rglob("*.mo"))]


def used_libraries(package: Path) -> list[Path]:
    """Return the folders, beside that of a package, of the libraries in its annotation ``uses``."""
    root = package / "package.mo"
    uses = _USES.search(root.read_text(encoding="utf-8")) if root.is_file() else None
    return [package.parent / name for name in _LIBRARY.findall(uses[1])] if uses else []


class SourceMap:
    """Map the front end's byte spans to ``file:line``; it names a file by the FNV-1a hash of its path."""

    def __init__(self, files: list[Path]) -> None:
        self.files = files
        self._of_hash = {_fnv1a(str(file).encode()): file for file in files}

    def location(self, span: Node | None) -> str:
        """Return ``file:line`` of a span, or ``<unknown place>``."""
        file = self._of_hash.get(span["source"]) if span else None
        if span is None or file is None:
            return "<unknown place>"
        line = file.read_bytes().count(b"\n", 0, span["start"]) + 1
        return f"{file}:{line}"


def _fnv1a(data: bytes) -> int:
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value
