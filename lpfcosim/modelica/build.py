"""Build FMUs from Modelica: translate, compile, archive; cached by digest of sources and tools."""

from __future__ import annotations

import functools
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from platformdirs import user_cache_path

from lpfcosim.errors import InputError, RunError
from lpfcosim.modelica.flat import flatten, package_files

PACKAGE = Path(__file__).parents[2] / "fmus" / "LISAPathfinder"
MODELS = ("Plant", "Actuation", "OpticalMetrology", "DragFreeControl", "SuspensionControl")
STEP = 0.1  # s, internal step; shorter communication steps are taken as they are
RUNTIME = Path(__file__).parent / "runtime"
_HEADERS = ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h")
# Without contraction every compiler gives the same bits.
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-fvisibility=hidden", "-g0")


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
    named = os.environ.get("CC")
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
    return done.stdout.splitlines()[0].strip()


def cache_directory() -> Path:
    """Folder of the built FMUs: ``$LPFCOSIM_CACHE``, or the user's cache folder."""
    named = os.environ.get("LPFCOSIM_CACHE")
    return Path(named) if named else user_cache_path("lpfcosim")


def digest(package: Path = PACKAGE) -> str:
    """SHA-256 over Modelica sources, generator, runtime and tool versions."""
    total = hashlib.sha256()
    here = sorted([*Path(__file__).parent.glob("*.py"), *RUNTIME.iterdir()])
    for file in (*package_files(package), *here):
        content = file.read_bytes()
        total.update(f"{file.name} {len(content)}\n".encode() + content)
    tools = [f"{name} {_version(name)}" for name in ("rumoca", "sympy", "fmpy")]
    total.update("\n".join([*tools, compiler().version, platform.system(), platform.machine()]).encode())
    return total.hexdigest()


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        raise InputError(
            f"FMUs cannot be built: '{distribution}' is not installed; "
            "install the build extra (pip install 'lpfcosim[build]')"
        ) from None


def build(models: Sequence[str] = MODELS, package: Path = PACKAGE, *, force: bool = False) -> dict[str, Path]:
    """Return the FMU of each model, built if the cache does not hold it.

    Raises
    ------
    InputError, UnsupportedError
        If a model is wrong or not translatable, or no compiler is there.
    RunError
        If the generated C does not compile.
    """
    archives = locations(models, package)
    for model, archive in archives.items():
        if force or not archive.is_file():
            build_one(package, f"{package.stem}.{model}", archive)
    return archives


def locations(models: Sequence[str] = MODELS, package: Path = PACKAGE) -> dict[str, Path]:
    """Where the cache holds, or would hold, the FMU of each model."""
    folder = cache_directory() / digest(package)[:16]
    return {model: folder / f"{model}.fmu" for model in models}


def copy(archives: Mapping[str, Path], directory: Path) -> dict[str, Path]:
    """Copy FMUs to ``directory``, made if need be."""
    directory.mkdir(parents=True, exist_ok=True)
    return {model: Path(shutil.copy(archive, directory)) for model, archive in archives.items()}


def build_one(package: Path, model: str, archive: Path) -> None:
    """Translate ``model`` (full Modelica name) and write its FMU to ``archive``, all or nothing."""
    from lpfcosim.modelica import codegen, description, system

    flat = flatten(package, model)
    translated = system.build(flat)
    where = codegen.layout(translated)
    header = codegen.header(translated, where, STEP)
    body = codegen.source(translated, where, token="@token@")
    token = str(
        uuid.uuid5(uuid.NAMESPACE_URL, hashlib.sha256((header + body + _runtime_text()).encode()).hexdigest())
    )
    tool = f"lpfcosim {metadata.version('lpfcosim')} with rumoca {_version('rumoca')}"

    archive.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as name:
        root = Path(name)
        sources = root / "sources"
        sources.mkdir()
        (sources / "model.h").write_text(header, encoding="utf-8")
        (sources / "model.c").write_text(body.replace("@token@", token), encoding="utf-8")
        for file in (*RUNTIME.iterdir(), *(_headers() / h for h in _HEADERS)):
            shutil.copyfile(file, sources / file.name)
        units = sorted(p.name for p in sources.glob("*.c"))
        (sources / "buildDescription.xml").write_text(
            description.build_description(translated.name, units), encoding="utf-8"
        )
        (root / "modelDescription.xml").write_text(
            description.model_description(flat, translated, where, token, STEP, tool), encoding="utf-8"
        )
        binary = root / "binaries" / _platform_tuple() / f"{translated.name}{_library_extension()}"
        binary.parent.mkdir(parents=True)
        _compile(sources, units, binary)
        _archive(root, archive)


def _runtime_text() -> str:
    return "".join(p.read_text(encoding="utf-8") for p in sorted(RUNTIME.iterdir()))


def _headers() -> Path:
    import fmpy

    return Path(fmpy.__file__).parent / "c-code"


def _platform_tuple() -> str:
    import fmpy

    return str(fmpy.platform_tuple)


def _library_extension() -> str:
    import fmpy

    return str(fmpy.sharedLibraryExtension)


def _compile(sources: Path, units: list[str], binary: Path) -> None:
    command = [*compiler().command, *_FLAGS, "-o", str(binary), *units, *([] if os.name == "nt" else ["-lm"])]
    done = subprocess.run(command, cwd=sources, capture_output=True, text=True, check=False)
    if done.returncode or not binary.is_file():
        raise RunError(
            f"the generated C of {binary.stem} does not compile with {compiler().version}:\n{done.stderr}"
        )


def _archive(root: Path, archive: Path) -> None:
    # Fixed times and order: the same sources give the same bytes.
    partial = archive.with_suffix(f".{os.getpid()}.part")
    with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as target:
        for file in sorted(p for p in root.rglob("*") if p.is_file()):
            info = zipfile.ZipInfo(file.relative_to(root).as_posix(), (1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            target.writestr(info, file.read_bytes())
    partial.replace(archive)
