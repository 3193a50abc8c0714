"""Build FMUs from Modelica: translate, compile, archive; cached by digest of sources and tools."""

from __future__ import annotations

import hashlib
import io
import os
import platform
import shutil
import tempfile
import uuid
import zipfile
from collections.abc import Callable, Collection, Mapping
from importlib import metadata
from pathlib import Path

from platformdirs import user_cache_path

from fit import units
from fit.files import atomic
from lpfcosim.errors import InputError
from lpfcosim.modelica.compiler import compile_library, compiler
from lpfcosim.modelica.frontend import flatten
from lpfcosim.modelica.sources import package_files

PACKAGE = Path(__file__).parents[2] / "fmus" / "LISAPathfinder"
#: FMUs of LISA Pathfinder by name, and the classes of its package that they are made from. An FMU of another
#: package has the name of the package before that of the class, as LISAPlant of LISA.Plant.
MODELS = {
    "Plant": "OneAxis.Plant",
    "Actuation": "OneAxis.Actuation",
    "OpticalMetrology": "OneAxis.Interferometer",
    "DragFreeControl": "OneAxis.DragFreeController",
    "SuspensionControl": "OneAxis.SuspensionController",
    "WholePlant": "SixDof.Plant",
    "WholeActuation": "SixDof.Actuation",
    "WholeMetrology": "SixDof.Interferometer",
    "InertialSensor": "SixDof.InertialSensor",
    "StarTracker": "SixDof.StarTracker",
    "WholeDragFreeControl": "SixDof.DragFreeController",
    "WholeSuspensionControl": "SixDof.SuspensionController",
    "AttitudeControl": "SixDof.AttitudeController",
}
STEP = 0.1  # s, internal step; shorter communication steps are taken as they are
RUNTIME = Path(__file__).parent / "runtime"
ENGINE = Path(__file__).parents[1] / "cosim" / "engine.c"
_HEADERS = ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h")


def packages(package: Path = PACKAGE) -> list[Path]:
    """Return the folder of a Modelica package, and those of the packages beside it."""
    siblings = (root.parent for root in sorted(package.parent.glob("*/package.mo")))
    return [package, *(folder for folder in siblings if folder != package)]


def package_of(model: str, package: Path = PACKAGE) -> Path:
    """Return the folder of the package that an FMU is made from: `package`, or the one it is named after."""
    siblings = packages(package)[1:]
    return next((folder for folder in siblings if model.startswith(folder.name)), package)


def cache_directory() -> Path:
    """Folder of the built FMUs: ``$LPFCOSIM_CACHE``, or the user's cache folder."""
    path = os.environ.get("LPFCOSIM_CACHE")
    return Path(path) if path else user_cache_path("lpfcosim")


def source_files(package: Path = PACKAGE) -> dict[str, Path]:
    """All that FMUs are made from, by name: Modelica sources, generator and runtime."""
    generator = sorted([*Path(__file__).parent.glob("*.py"), *RUNTIME.iterdir()])
    generator.append(Path(units.__file__))  # the units of a description
    return {
        **{f.relative_to(package.parent).as_posix(): f for f in package_files(package)},
        **{f.relative_to(Path(__file__).parents[2]).as_posix(): f for f in generator},
    }


def digest(package: Path = PACKAGE) -> str:
    """SHA-256 over Modelica sources, generator, runtime and tool versions."""
    sha256 = digest_of_files(source_files(package))
    tools = [f"{name} {tool_version(name)}" for name in ("rumoca", "sympy", "fmpy")]
    tools += [compiler().version, platform.system(), platform.machine()]
    sha256.update("\n".join(tools).encode())
    return sha256.hexdigest()


def digest_of_files(files: Mapping[str, Path]) -> hashlib._Hash:
    """Return the SHA-256 of files and their names, to which more can be added."""
    sha256 = hashlib.sha256()
    for name, file in files.items():
        content = file.read_bytes()
        sha256.update(f"{name} {len(content)}\n".encode() + content)
    return sha256


def tool_version(distribution: str) -> str:
    """Return the version of a tool; InputError if it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        raise InputError(
            f"the Modelica models cannot be translated: '{distribution}' is not installed; "
            "install the build extra (pip install 'lpfcosim[build]')"
        ) from None


def build(
    models: Collection[str] = MODELS,
    package: Path = PACKAGE,
    *,
    on_progress: Callable[[int], None] = lambda _count: None,
) -> dict[str, Path]:
    """Return the FMU of each model, built if it is not in the cache.

    Parameters
    ----------
    models : collection of str
        Names of FMUs: those of `MODELS`, or of classes of the package.
    package : Path
        Folder of the Modelica package.
    on_progress : callable
        Called with the number of FMUs done.

    Raises
    ------
    InputError, UnsupportedError
        If a model is wrong or not translatable, or no compiler is there.
    RunError
        If the generated C does not compile.
    """
    archives = locations(models, package)
    for count, (model, archive) in enumerate(archives.items(), start=1):
        if not archive.is_file():
            build_one(package_of(model, package), class_name(model, package), archive, name=model)
        on_progress(count)
    return archives


def class_name(model: str, package: Path = PACKAGE) -> str:
    """Return the full Modelica name of the class that an FMU is made from."""
    folder = package_of(model, package)
    name = MODELS.get(model, model) if folder == package else model.removeprefix(folder.name)
    return f"{folder.stem}.{name}"


def locations(models: Collection[str] = MODELS, package: Path = PACKAGE) -> dict[str, Path]:
    """Where the FMU of each model is in the cache, or would be."""
    folders = {model: package_of(model, package) for model in models}
    digests = {folder: digest(folder)[:16] for folder in dict.fromkeys(folders.values())}
    return {model: cache_directory() / digests[folder] / f"{model}.fmu" for model, folder in folders.items()}


def engine_library() -> Path:
    """Return the compiled stepping loop (``lpfcosim/cosim/engine.c``), built if it is not there."""
    import fmpy

    name = hashlib.sha256(ENGINE.read_bytes() + compiler().version.encode()).hexdigest()[:16]
    library = cache_directory() / f"engine-{name}{fmpy.sharedLibraryExtension}"
    if not library.is_file():
        library.parent.mkdir(parents=True, exist_ok=True)
        partial = atomic.temporary(library)
        compile_library(ENGINE, partial)
        partial.replace(library)
    return library


def copy(archives: Mapping[str, Path], directory: Path) -> dict[str, Path]:
    """Copy FMUs to ``directory``, made if need be."""
    directory.mkdir(parents=True, exist_ok=True)
    return {model: Path(shutil.copy(archive, directory)) for model, archive in archives.items()}


def build_one(package: Path, model: str, archive: Path, *, name: str | None = None) -> None:
    """Translate ``model`` (full Modelica name) and write its FMU to ``archive``, all or nothing.

    The FMU is called ``name``, by default as its class without the package.
    """
    import fmpy

    from lpfcosim.modelica import c_printer
    from lpfcosim.modelica.model_description import print_description
    from lpfcosim.modelica.translate import translate

    flat = flatten(package, model)
    sorted_model = translate(flat, name)
    layout = c_printer.make_layout(sorted_model)
    header = c_printer.print_header(sorted_model, layout, STEP)
    body = c_printer.print_source(sorted_model, layout)
    headers = Path(fmpy.__file__).parent / "c-code"
    runtime = [*sorted(RUNTIME.iterdir()), *(headers / file for file in _HEADERS)]
    content = "".join([header, body, *(file.read_text(encoding="utf-8") for file in runtime)])
    guid = str(uuid.uuid5(uuid.NAMESPACE_OID, hashlib.sha256(content.encode()).hexdigest()))
    # One translation unit: the compiler then sees the equations from inside the step.
    unit = "".join(f'#include "{file}"\n' for file in ("model.c", "core.c", "instance.c", "fmi2.c"))
    tool = f"lpfcosim {tool_version('lpfcosim')} with rumoca {tool_version('rumoca')}"
    description = print_description(flat, sorted_model, layout, guid=guid, step=STEP, tool=tool)
    texts = {
        "sources/model.h": header,
        "sources/model.c": body.replace(c_printer.GUID, guid),
        "sources/all.c": unit,
        "modelDescription.xml": description,
        "documentation/licenses/license.txt": _licence(),
    }
    archive.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        root = Path(folder)
        binaries = root / "binaries" / fmpy.platform
        for directory in (root / "sources", root / "documentation" / "licenses", binaries):
            directory.mkdir(parents=True)
        for path, text in texts.items():
            (root / path).write_text(text, encoding="utf-8")
        for file in runtime:
            shutil.copyfile(file, root / "sources" / file.name)
        library = binaries / f"{sorted_model.name}{fmpy.sharedLibraryExtension}"
        compile_library(root / "sources" / "all.c", library)
        write_archive(root, archive)


def _licence() -> str:
    file = Path(__file__).parents[2] / "LICENSE"
    text = (
        file.read_text(encoding="utf-8")
        if file.is_file()
        else metadata.distribution("lpfcosim").read_text("licenses/LICENSE")
    )
    return f"{text}\nThe headers fmi2*.h are of the Modelica Association; each has its licence inside.\n"


def write_archive(root: Path, archive: Path) -> None:
    """Zip the folder ``root`` to ``archive``; the same files give the same bytes."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as target:
        for file in sorted(p for p in root.rglob("*") if p.is_file()):
            info = zipfile.ZipInfo(file.relative_to(root).as_posix(), (1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            target.writestr(info, file.read_bytes())
    atomic.write(archive, content.getvalue())
