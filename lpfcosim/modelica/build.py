"""Build FMUs from Modelica: translate, compile, archive; cached by digest of sources and tools.

Prebuilt FMUs of a wheel are used as long as their sources are unchanged.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import tempfile
import uuid
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path

from platformdirs import user_cache_path

from fit import units
from lpfcosim.errors import InputError
from lpfcosim.modelica import prebuilt
from lpfcosim.modelica.compiler import (
    TARGETS,
    Target,
    compile_binaries,
    compile_library,
    compiler,
    cross_compiler,
)
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
_CORE = ("core.c", "core.h", "instance.c")
_HEADERS = {
    "2.0": ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    "3.0": ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}


def packages(package: Path = PACKAGE) -> list[Path]:
    """Return the folder of a Modelica package, and those of the packages beside it."""
    others = (root.parent for root in sorted(package.parent.glob("*/package.mo")))
    return [package, *(folder for folder in others if folder != package)]


def package_of(model: str, package: Path = PACKAGE) -> Path:
    """Return the folder of the package that an FMU is made from: `package`, or the one it is named after."""
    others = packages(package)[1:]
    return next((folder for folder in others if model.startswith(folder.name)), package)


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


def shipped_sources(package: Path = PACKAGE) -> dict[str, Path]:
    """All that the FMUs of a wheel are made from, by name, with the packages beside `package`."""
    return {name: file for folder in packages(package) for name, file in source_files(folder).items()}


def digest(package: Path = PACKAGE) -> str:
    """SHA-256 over Modelica sources, generator, runtime and tool versions."""
    sha256 = digest_of_files(source_files(package))
    tools = [*_tools(), compiler().version, platform.system(), platform.machine()]
    sha256.update("\n".join(tools).encode())
    return sha256.hexdigest()


def digest_of_files(files: Mapping[str, Path]) -> hashlib._Hash:
    """Return the SHA-256 of files and their names, to which more can be added."""
    sha256 = hashlib.sha256()
    for name, file in files.items():
        content = file.read_bytes()
        sha256.update(f"{name} {len(content)}\n".encode() + content)
    return sha256


def _tools() -> list[str]:
    return [f"{name} {tool_version(name)}" for name in ("rumoca", "sympy", "fmpy")]


def tool_version(distribution: str, problem: str = "FMUs cannot be built") -> str:
    """Return the version of a tool; InputError with the `problem` if it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        raise InputError(
            f"{problem}: '{distribution}' is not installed; "
            "install the build extra (pip install 'lpfcosim[build]')"
        ) from None


def build(
    models: Collection[str] = MODELS,
    package: Path = PACKAGE,
    *,
    fmi: str = "3.0",
    force: bool = False,
    on_progress: Callable[[int], None] = lambda _count: None,
) -> dict[str, Path]:
    """Return the FMU of each model, built if it neither came with the package nor lies in the cache.

    Parameters
    ----------
    models : collection of str
        Names of FMUs: those of `MODELS`, or of classes of the package.
    package : Path
        Folder of the Modelica package.
    fmi : str
        Version of FMI, ``2.0`` or ``3.0``.
    force : bool
        Build again, even if it is in the cache.
    on_progress : callable
        Called with the number of FMUs done.

    Raises
    ------
    InputError, UnsupportedError
        If a model is wrong or not translatable, or no compiler is there.
    RunError
        If the generated C does not compile.
    """
    archives = _cached(models, package, fmi) if force else locations(models, package, fmi=fmi)
    for count, (model, archive) in enumerate(archives.items(), start=1):
        if force or not _is_whole(archive):
            folder = package_of(model, package)
            build_one(folder, class_name(model, package), archive, name=model, fmi=fmi)
        on_progress(count)
    return archives


def class_name(model: str, package: Path = PACKAGE) -> str:
    """Return the full Modelica name of the class that an FMU is made from."""
    folder = package_of(model, package)
    name = MODELS.get(model, model) if folder == package else model.removeprefix(folder.name)
    return f"{folder.stem}.{name}"


def _is_whole(archive: Path) -> bool:
    try:
        with zipfile.ZipFile(archive) as stored:
            return stored.testzip() is None
    except (OSError, zipfile.BadZipFile):
        return False


def locations(
    models: Collection[str] = MODELS, package: Path = PACKAGE, *, fmi: str = "3.0"
) -> dict[str, Path]:
    """Where the FMU of each model is, or would be: with the package, or in the cache."""
    if package != PACKAGE:
        return _cached(models, package, fmi)
    try:
        files = [f"{model}.fmu" for model in models]
        archives = prebuilt.find(f"fmi{fmi[0]}", files, shipped_sources(package))
        return dict(zip(models, archives, strict=True))
    except prebuilt.StalePrebuiltError as reason:
        with _with_reason(reason):
            return _cached(models, package, fmi)


def _cached(models: Collection[str], package: Path, fmi: str) -> dict[str, Path]:
    folders = {model: package_of(model, package) for model in models}
    digests = {folder: digest(folder)[:16] for folder in dict.fromkeys(folders.values())}
    cache = cache_directory()
    return {
        model: cache / digests[folder] / f"fmi{fmi[0]}" / f"{model}.fmu" for model, folder in folders.items()
    }


@contextmanager
def _with_reason(reason: prebuilt.StalePrebuiltError) -> Iterator[None]:
    """Prepend to an error why the prebuilt files cannot be used."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{reason}, and {error}") from None


def engine_library() -> Path:
    """Return the compiled stepping loop (``lpfcosim/cosim/engine.c``), built if it is not there."""
    import fmpy

    try:
        name = f"{prebuilt.platform_name()}{fmpy.sharedLibraryExtension}"
        return prebuilt.find("engine", [name], {ENGINE.name: ENGINE})[0]
    except prebuilt.StalePrebuiltError as reason:
        with _with_reason(reason):
            version = compiler().version
    name = hashlib.sha256(ENGINE.read_bytes() + version.encode()).hexdigest()[:16]
    library = cache_directory() / f"engine-{name}{fmpy.sharedLibraryExtension}"
    if not library.is_file():
        library.parent.mkdir(parents=True, exist_ok=True)
        partial = library.with_suffix(f".{os.getpid()}.part")
        compile_library(ENGINE.parent, [ENGINE.name], partial)
        partial.replace(library)
    return library


def prebuild(
    folder: Path,
    version: str,
    prepared: Mapping[str, prebuilt.PrebuiltGroup],
    models: Collection[str],
    targets: Sequence[Target] = TARGETS,
) -> None:
    """Build what a wheel carries compiled, and write the manifest.

    Parameters
    ----------
    folder : Path
        Where `prebuilt` shall find it.
    version : str
        Of this package, which need not be installed yet.
    prepared : mapping of str to PrebuiltGroup
        Groups that are in the folder already.
    models : collection of str
        Names of FMUs.
    targets : sequence of Target
        Platforms to build for.

    Raises
    ------
    InputError
        If one of the tools is not installed.
    """
    tools = [*_tools(), cross_compiler().version]
    groups = dict(prepared)
    for fmi in _HEADERS:
        group = f"fmi{fmi[0]}"
        supported = [t for t in targets if t.folder(fmi)]
        groups[group] = prebuilt.PrebuiltGroup([t.name for t in supported], shipped_sources())
        for model in models:
            package, archive = package_of(model), folder / group / f"{model}.fmu"
            build_one(
                package, class_name(model), archive, name=model, fmi=fmi, version=version, targets=supported
            )
    groups["engine"] = prebuilt.PrebuiltGroup([t.name for t in targets], {ENGINE.name: ENGINE})
    (folder / "engine").mkdir()
    for target in targets:
        library = folder / "engine" / f"{target.name}{target.extension}"
        compile_library(ENGINE.parent, [ENGINE.name], library, target)
    prebuilt.write(folder, groups, tools)


def copy(archives: Mapping[str, Path], directory: Path) -> dict[str, Path]:
    """Copy FMUs to ``directory``, made if need be."""
    directory.mkdir(parents=True, exist_ok=True)
    return {model: Path(shutil.copy(archive, directory)) for model, archive in archives.items()}


def build_one(
    package: Path,
    model: str,
    archive: Path,
    *,
    name: str | None = None,
    fmi: str = "3.0",
    version: str | None = None,
    targets: Sequence[Target] = (),
) -> None:
    """Translate ``model`` (full Modelica name) and write its FMU to ``archive``, all or nothing.

    The FMU is called ``name``, by default as its class without the package. It is for this machine, or for
    ``targets``; it names ``version`` of this package, by default the one installed.
    """
    from lpfcosim.modelica import c_printer, model_description, variables
    from lpfcosim.modelica.documentation import write_documentation
    from lpfcosim.modelica.sensitivity import Sensitivity
    from lpfcosim.modelica.translate import translate

    flat = flatten(package, model)
    sorted_model = translate(flat, name)
    sensitivity = Sensitivity(sorted_model)
    layout = c_printer.make_layout(sorted_model)
    fmi_variables = variables.declare_variables(layout, fmi)
    arrays = variables.array_extents(fmi_variables, layout)
    header = c_printer.print_header(sorted_model, layout, arrays, STEP)
    body = c_printer.print_source(sorted_model, layout, sensitivity, arrays, token="@token@")
    runtime = "".join(file.read_text(encoding="utf-8") for file in _runtime(fmi))
    token = str(
        uuid.uuid5(uuid.NAMESPACE_OID, hashlib.sha256((header + body + runtime).encode()).hexdigest())
    )
    tool = f"lpfcosim {version or tool_version('lpfcosim')} with rumoca {tool_version('rumoca')}"
    description = model_description.ModelDescription(
        flat, sorted_model, sensitivity, fmi_variables, token, STEP, tool
    )

    archive.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        root = Path(folder)
        sources = root / "sources"
        units = _write_sources(sources, header, body.replace("@token@", token), fmi)
        if fmi == "3.0":
            text = model_description.build_description(sorted_model.name, units)
            (sources / "buildDescription.xml").write_text(text, encoding="utf-8")
        text = description.fmi3() if fmi == "3.0" else description.fmi2(units)
        (root / "modelDescription.xml").write_text(text, encoding="utf-8")
        compile_binaries(sources, units, root / "binaries", sorted_model.name, fmi=fmi, targets=targets)
        write_documentation(root, sorted_model, fmi_variables, fmi)
        write_archive(root, archive)


def _write_sources(folder: Path, header: str, body: str, fmi: str) -> list[str]:
    """Write the C sources of a model and of the runtime; return those to be compiled."""
    folder.mkdir()
    (folder / "model.h").write_text(header, encoding="utf-8")
    (folder / "model.c").write_text(body, encoding="utf-8")
    for file in _runtime(fmi):
        shutil.copyfile(file, folder / file.name)
    # One translation unit: the compiler then sees the equations from inside the step.
    files = ["model.c", "core.c", "instance.c", f"fmi{fmi[0]}.c"]
    (folder / "all.c").write_text("".join(f'#include "{p}"\n' for p in files), encoding="utf-8")
    return ["all.c"]


def _runtime(fmi: str) -> Iterator[Path]:
    import fmpy

    headers = Path(fmpy.__file__).parent / "c-code"
    yield from (RUNTIME / name for name in (*_CORE, f"fmi{fmi[0]}.c"))
    yield from (headers / name for name in _HEADERS[fmi])


def write_archive(root: Path, archive: Path) -> None:
    """Zip the folder ``root`` to ``archive``; the same files give the same bytes."""
    partial = archive.with_suffix(f".{os.getpid()}.part")
    with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as target:
        for file in sorted(p for p in root.rglob("*") if p.is_file()):
            info = zipfile.ZipInfo(file.relative_to(root).as_posix(), (1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            target.writestr(info, file.read_bytes())
    partial.replace(archive)
