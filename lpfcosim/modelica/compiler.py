"""The C compiler that builds FMUs: the one of the system, or the ziglang package from PyPI."""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from lpfcosim.errors import InputError, RunError

# Without contraction every compiler gives the same bits.
FLAGS = (
    "-std=c99",
    "-O3",
    "-fPIC",
    "-shared",
    "-ffp-contract=off",
    "-fvisibility=hidden",
    "-g0",
    "-Werror=implicit-function-declaration",
)


@dataclass(frozen=True)
class Compiler:
    """A C compiler: its command and what it calls itself."""

    command: tuple[str, ...]
    version: str


@functools.cache
def compiler() -> Compiler:
    """Find a C compiler: ``$CC``, one on the path, or the ziglang package.

    Raises
    ------
    InputError
        With the remedy, if there is none.
    """
    variable = os.environ.get("CC", "").strip()
    candidates = [tuple(variable.split())] if variable else [("cc",), ("gcc",), ("clang",)]
    for command in candidates:
        if shutil.which(command[0]):
            return Compiler(command, _first_line([*command, "--version"]))
    if not variable:
        with contextlib.suppress(metadata.PackageNotFoundError):
            return zig()
    missing = (
        f"the compiler named by CC, '{variable}', is not there" if variable else "no C compiler was found"
    )
    raise InputError(
        f"FMUs cannot be built: {missing}; install one from PyPI with 'pip install ziglang', or set CC"
    )


def _first_line(command: Sequence[str]) -> str:
    try:
        process = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    except (OSError, subprocess.SubprocessError) as error:
        raise InputError(
            f"FMUs cannot be built: '{' '.join(command)}' fails ({error}); set CC to a C compiler"
        ) from None
    lines = process.stdout.splitlines()
    return lines[0].strip() if lines else " ".join(command[:-1])


def zig() -> Compiler:
    """Return the compiler of the ziglang package, whatever else there is.

    Raises
    ------
    PackageNotFoundError
        If it is not installed.
    """
    return Compiler((sys.executable, "-m", "ziglang", "cc"), f"zig cc {metadata.version('ziglang')}")


def compile_library(source: Path, binary: Path) -> None:
    """Compile a C file to the shared library ``binary`` for this machine.

    Raises
    ------
    RunError
        With what the compiler says, if it fails.
    """
    c_compiler = compiler()
    # In a folder of its own: for Windows, linkers leave further files beside the library.
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        library = Path(folder) / binary.name
        command = [*c_compiler.command, *FLAGS, "-o", str(library), source.name]
        command += [] if os.name == "nt" else ["-lm"]
        process = subprocess.run(command, cwd=source.parent, capture_output=True, text=True, check=False)
        if process.returncode or not library.is_file():
            raise RunError(
                f"the generated C of {binary.stem} does not compile with {c_compiler.version}:\n"
                f"{process.stderr}"
            )
        shutil.move(library, binary)
