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
class Target:
    """A platform to cross-compile for.

    Attributes
    ----------
    name, fmi2 : str
        Its folder in an FMU, for FMI 3.0 and 2.0; the latter is empty if FMI 2.0 has none.
    triple : str
        What zig calls it, with the oldest system that the binaries run on.
    extension : str
        Of a shared library.
    """

    name: str
    fmi2: str
    triple: str
    extension: str

    def folder(self, fmi: str) -> str:
        """Folder of the binary in an FMU, empty if this version of FMI has none."""
        return self.fmi2 if fmi == "2.0" else self.name


TARGETS = (
    Target("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", ".so"),
    Target("aarch64-linux", "", "aarch64-linux-gnu.2.17", ".so"),
    Target("x86_64-darwin", "darwin64", "x86_64-macos.11.0", ".dylib"),
    Target("aarch64-darwin", "", "aarch64-macos.11.0", ".dylib"),
    Target("x86_64-windows", "win64", "x86_64-windows-gnu", ".dll"),
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
        with contextlib.suppress(InputError):
            return cross_compiler()
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


def cross_compiler() -> Compiler:
    """Return the compiler for other platforms: the ziglang package, whatever else there is.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        version = metadata.version("ziglang")
    except metadata.PackageNotFoundError:
        raise InputError(
            "FMUs cannot be built for other platforms: 'ziglang' is not installed; "
            "install the build extra (pip install 'lpfcosim[build]')"
        ) from None
    return Compiler((sys.executable, "-m", "ziglang", "cc"), f"zig cc {version}")


def compile_library(sources: Path, units: Sequence[str], binary: Path, target: Target | None = None) -> None:
    """Compile the C files ``units`` of the folder ``sources`` to the shared library ``binary``.

    It is for this machine, or for ``target``.

    Raises
    ------
    RunError
        With what the compiler says, if it fails.
    """
    c_compiler = cross_compiler() if target else compiler()
    windows = target.extension == ".dll" if target else os.name == "nt"
    flags = [*FLAGS, *(_target_flags(target, binary) if target else ())]
    if target and windows:
        flags.remove("-fPIC")
    # In a folder of its own: for Windows, linkers leave further files beside the library.
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        library = Path(folder) / binary.name
        command = [*c_compiler.command, *flags, "-o", str(library), *units, *([] if windows else ["-lm"])]
        process = subprocess.run(command, cwd=sources, capture_output=True, text=True, check=False)
        if process.returncode or not library.is_file():
            raise RunError(
                f"the generated C of {binary.stem} does not compile with {c_compiler.version}:\n"
                f"{process.stderr}"
            )
        shutil.move(library, binary)


def _target_flags(target: Target, binary: Path) -> list[str]:
    flags = ["-target", target.triple, "-s"]
    if target.extension == ".dylib":
        # By default a library for macOS carries the path it was made at.
        flags.append(f"-Wl,-install_name,@rpath/{binary.name}")
    return flags


def compile_binaries(
    sources: Path, units: Sequence[str], binaries: Path, name: str, *, fmi: str, targets: Sequence[Target]
) -> None:
    """Compile as `compile_library` for each target, or this machine, into the ``binaries`` of an FMU."""
    import fmpy

    if not targets:
        folder = binaries / (fmpy.platform if fmi == "2.0" else fmpy.platform_tuple)
        folder.mkdir(parents=True)
        compile_library(sources, units, folder / f"{name}{fmpy.sharedLibraryExtension}")
    for target in targets:
        binary = binaries / target.folder(fmi) / f"{name}{target.extension}"
        binary.parent.mkdir(parents=True, exist_ok=True)
        compile_library(sources, units, binary, target)
