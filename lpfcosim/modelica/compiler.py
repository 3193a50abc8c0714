"""The C compiler that builds FMUs: the one of the system, or the ziglang package from PyPI."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from lpfcosim.errors import InputError, RunError

# Without contraction every compiler gives the same bits.
FLAGS = (
    "-std=c99",
    "-O2",
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
    named = os.environ.get("CC", "").strip()
    candidates = [tuple(named.split())] if named else [("cc",), ("gcc",), ("clang",)]
    for command in candidates:
        if shutil.which(command[0]):
            return Compiler(command, _first_line([*command, "--version"]))
    if not named:
        try:
            version = metadata.version("ziglang")
            return Compiler((sys.executable, "-m", "ziglang", "cc"), f"zig cc {version}")
        except metadata.PackageNotFoundError:
            pass
    missing = f"the compiler named by CC, '{named}', is not there" if named else "no C compiler was found"
    raise InputError(
        f"FMUs cannot be built: {missing}; install one from PyPI with 'pip install ziglang', or set CC"
    )


def _first_line(command: Sequence[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    except (OSError, subprocess.SubprocessError) as error:
        raise InputError(
            f"FMUs cannot be built: '{' '.join(command)}' fails ({error}); set CC to a C compiler"
        ) from None
    lines = done.stdout.splitlines()
    return lines[0].strip() if lines else " ".join(command[:-1])


def compile_library(sources: Path, units: Sequence[str], binary: Path) -> None:
    """Compile the C files ``units`` of the folder ``sources`` to the shared library ``binary``.

    Raises
    ------
    RunError
        With what the compiler says, if it fails.
    """
    command = [*compiler().command, *FLAGS, "-o", str(binary), *units, *([] if os.name == "nt" else ["-lm"])]
    done = subprocess.run(command, cwd=sources, capture_output=True, text=True, check=False)
    if done.returncode or not binary.is_file():
        raise RunError(
            f"the generated C of {binary.stem} does not compile with {compiler().version}:\n{done.stderr}"
        )
