"""What a wheel carries ready made: when it counts, and that all platforms' files are what they should be."""

import io
import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import fmpy
import h5py
import pytest
from fmpy.validation import validate_fmu

from lpfcosim.errors import InputError
from lpfcosim.modelica import build, prebuilt
from lpfcosim.models import fmu_names
from tests.oracles.binaries import READERS

ROOT = Path(__file__).parents[1]
CAMPAIGN = Path(__file__).parent / "two_experiments.toml"
SITE = "Lib/site-packages" if os.name == "nt" else f"lib/python3.{sys.version_info.minor}/site-packages"


# What counts as ready made --------------------------------------------------------------------------------


@pytest.fixture
def shipped(tmp_path, monkeypatch):
    """An installation with ready-made files (empty archives), a package of its own, and no build tools."""
    package = tmp_path / "fmus" / "LISAPathfinder"
    shutil.copytree(build.PACKAGE, package)
    engine = tmp_path / "engine.c"
    shutil.copy(build.ENGINE, engine)
    folder = tmp_path / "prebuilt"
    for kind in ("fmi2", "fmi3", "engine"):
        (folder / kind).mkdir(parents=True)
    for model in build.MODELS:
        for kind in ("fmi2", "fmi3"):
            with zipfile.ZipFile(folder / kind / f"{model}.fmu", "w") as archive:
                archive.writestr("model", f"{model} {kind}")
    (folder / "engine" / f"{prebuilt.platform_name()}{fmpy.sharedLibraryExtension}").write_bytes(b"engine")

    def unavailable(*_):
        raise InputError("FMUs cannot be built: no tools")

    monkeypatch.setattr(build, "PACKAGE", package)
    monkeypatch.setattr(build, "ENGINE", engine)
    monkeypatch.setattr(prebuilt, "FOLDER", folder)
    monkeypatch.setattr(build, "compiler", unavailable)
    monkeypatch.setattr(build, "_tools", unavailable)
    models = prebuilt.PrebuiltGroup([prebuilt.platform_name()], build.source_files(package))
    loop = prebuilt.PrebuiltGroup([prebuilt.platform_name()], {engine.name: engine})
    prebuilt.write(folder, {"fmi2": models, "fmi3": models, "engine": loop}, ["a tool"])
    return folder


def test_ready_made_files_need_no_tools(shipped):
    for fmi, kind in (("3.0", "fmi3"), ("2.0", "fmi2")):
        found = build.build(package=build.PACKAGE, fmi=fmi)
        assert found == {m: shipped / kind / f"{m}.fmu" for m in build.MODELS}
    assert build.engine_library().read_bytes() == b"engine"


CHANGES = {
    "OneAxis/Plant.mo": lambda file: file.write_text(f"{file.read_text()}// edited\n"),
    "Functions.mo": lambda file: file.write_text(f"{file.read_text()}// edited\n"),
    "New.mo": lambda file: file.write_text("within LISAPathfinder; model New end New;"),
    "Types.mo": Path.unlink,
}


@pytest.mark.parametrize("file", CHANGES)
def test_changed_models_are_not_answered_with_old_fmus(shipped, file):
    CHANGES[file](build.PACKAGE / file)
    with pytest.raises(
        InputError, match=rf"{file} has changed since .* were made, and FMUs cannot be built: no tools"
    ):
        build.build(package=build.PACKAGE)
    assert build.engine_library().is_file()


def test_edited_engine_is_not_answered_with_the_old_library(shipped):
    build.ENGINE.write_text(build.ENGINE.read_text() + "/* edited */\n")
    with pytest.raises(InputError, match=r"engine.c has changed since .*: no tools"):
        build.engine_library()
    assert build.build(package=build.PACKAGE)


def test_digest_covers_models_generator_and_runtime():
    covered = set(build.source_files().values())
    generator = build.ENGINE.parent / "modelica"
    assert covered >= {*build.PACKAGE.rglob("*.mo"), *generator.rglob("*.py"), *generator.rglob("*.[ch]")}


DAMAGES = {
    r"Plant.fmu is missing or damaged, and": lambda folder: (folder / "fmi3" / "Plant.fmu").write_bytes(b"x"),
    r"Plant.fmu is missing or damaged, and ": lambda folder: (folder / "fmi3" / "Plant.fmu").unlink(),
    r"manifest\.json is damaged, and": lambda folder: (folder / "manifest.json").write_text('{"fmi3": {}}'),
    r"manifest\.json is damaged, and ": lambda folder: (folder / "manifest.json").write_text("{"),
    r"came without compiled files, and FMUs cannot be built: no tools": shutil.rmtree,
}


@pytest.mark.parametrize("message", DAMAGES)
def test_damaged_and_missing_files_are_noticed(shipped, message):
    DAMAGES[message](shipped)
    with pytest.raises(InputError, match=message.strip()):
        build.build(package=build.PACKAGE)


def test_other_platform_is_named(shipped, monkeypatch):
    monkeypatch.setattr(fmpy, "platform_tuple", "sparc-plan9")
    with pytest.raises(InputError, match=r"without compiled files \(fmi3\) for sparc-plan9"):
        build.build(package=build.PACKAGE)


# What lies in a wheel -------------------------------------------------------------------------------------


def functions(fmi: str) -> set[str]:
    """Functions of the standard's header, for FMI 2.0 without those of model exchange."""
    header = (Path(fmpy.__file__).parent / "c-code" / f"fmi{fmi}Functions.h").read_text("utf-8")
    section = "Functions for FMI2 for "
    header = re.sub(f"{section}Model Exchange.*?(?={section}Co-Simulation)", "", header, flags=re.DOTALL)
    return set(re.findall(rf"^\s*FMI{fmi}_Export\s+\w+TYPE\s+(\w+);", header, re.MULTILINE))


def run(*command: object, **options: object) -> subprocess.CompletedProcess[str]:
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", folder, ROOT)
    (made,) = folder.glob("*.whl")
    return made


PLATFORMS = {"x86_64-linux", "aarch64-linux", "x86_64-darwin", "aarch64-darwin", "x86_64-windows"}


@pytest.mark.long
def test_wheel_carries_every_platform(wheel, tmp_path):
    assert wheel.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(wheel) as stored:
        names = {n for n in stored.namelist() if n.startswith("lpfcosim/prebuilt/")}
        files = {n.removeprefix("lpfcosim/prebuilt/"): stored.read(n) for n in names}
    archives = {f"fmi{v}/{m}.fmu" for v in "23" for m in fmu_names()}
    extension = {"linux": ".so", "darwin": ".dylib", "windows": ".dll"}
    engines = {f"engine/{p}{extension[p.split('-')[1]]}" for p in PLATFORMS}
    modules = {f"numpy/{m}.py" for m in fmu_names()}
    assert set(files) == {"manifest.json", *archives, *engines, *modules}
    for name in engines:
        platform, exported = READERS[Path(name).suffix](files[name])
        assert platform == Path(name).stem
        assert exported == {"run_block", "mixed_set", "mixed_get", "mixed_step"}
    for name in archives:
        check_archive(files[name], name[3], Path(name).stem)
        fmu = tmp_path / Path(name).name
        fmu.write_bytes(files[name])
        assert validate_fmu(fmu) == []


def check_archive(content: bytes, fmi: str, model: str) -> None:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        binaries = {n: archive.read(n) for n in archive.namelist() if n.startswith("binaries/")}
    folders = {"linux64", "darwin64", "win64"} if fmi == "2" else PLATFORMS
    assert {n.split("/")[1] for n in binaries} == folders
    assert len(binaries) == len(folders)
    standard = {"linux64": "x86_64-linux", "darwin64": "x86_64-darwin", "win64": "x86_64-windows"}
    for name, image in binaries.items():
        folder, file = name.split("/")[1:]
        assert Path(file).stem == model
        platform, exported = READERS[Path(file).suffix](image)
        assert platform == standard.get(folder, folder)
        assert exported == functions(fmi)
        for version in re.findall(rb"GLIBC_2\.(\d+)", image):
            assert int(version) <= 17  # as old as the manylinux2014 wheels of NumPy and SciPy


@pytest.fixture(scope="session")
def installed(wheel, tmp_path_factory):
    """Folder of an environment that holds the wheel and nothing to build with."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder, with_pip=True)
    run(folder / "bin" / "python", "-m", "pip", "install", "-q", wheel)
    for tool in ("rumoca", "sympy", "ziglang"):
        assert not (folder / SITE / tool).exists()
    yield folder
    shutil.rmtree(folder)  # half a gigabyte


def lpfcosim(installed: Path, home: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command of the installed wheel where no compiler can be found."""
    bare = {"HOME": str(home), "PATH": str(home), "LPFCOSIM_CACHE": str(home / "cache")}
    command = [str(a) for a in (installed / "bin" / "lpfcosim", *arguments)]
    return subprocess.run(command, env=bare, cwd=home, capture_output=True, text=True, check=False)


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="written for POSIX environments")
def test_wheel_runs_without_a_compiler_and_gives_the_same_bits(installed, tmp_path):
    done = lpfcosim(installed, tmp_path, "run", CAMPAIGN, "--out", "wheel", "--quiet")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "wheel" / "report.html").is_file()
    assert not (tmp_path / "cache").exists()
    run(sys.executable, "-m", "lpfcosim", "run", CAMPAIGN, "--out", tmp_path / "source", "--quiet")
    files = sorted((tmp_path / "source" / "telemetry").glob("*.h5"))
    assert len(files) == 3
    for path in files:
        with h5py.File(path) as ours, h5py.File(tmp_path / "wheel" / "telemetry" / path.name) as theirs:
            channels = [n for n, d in ours.items() if isinstance(d, h5py.Dataset)]
            assert "o_12" in channels
            for name in channels:
                assert ours[name][()].tobytes() == theirs[name][()].tobytes(), name


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="written for POSIX environments")
def test_edited_model_of_an_installed_wheel_is_refused_with_the_remedy(installed, tmp_path):
    model = installed / SITE / "fmus" / "LISAPathfinder" / "OneAxis" / "Plant.mo"
    original = model.read_bytes()
    model.write_bytes(original + b"// edited\n")
    try:
        done = lpfcosim(installed, tmp_path, "run", CAMPAIGN, "--quiet")
    finally:
        model.write_bytes(original)
    assert done.returncode == 2
    assert re.search(r"Plant\.mo has changed .*'rumoca' .*pip install 'lpfcosim\[build\]'", done.stderr)
    assert lpfcosim(installed, tmp_path, "fmu", "list").stdout.count("prebuilt/") == len(fmu_names())


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="written for POSIX environments")
def test_editable_install_downloads_no_build_tools_of_its_own(tmp_path):
    venv.create(tmp_path / "venv", with_pip=True)
    checkout = tmp_path / "checkout"
    shutil.copytree(ROOT, checkout, ignore=shutil.ignore_patterns(".git", ".venv", "__pycache__", "*.h5"))
    python = tmp_path / "venv" / "bin" / "python"
    done = run(python, "-m", "pip", "install", "--no-deps", "-v", "-e", checkout)
    assert "hatchling" in done.stdout + done.stderr
    assert "ziglang" not in done.stdout + done.stderr
    assert not (checkout / "lpfcosim" / "prebuilt").exists()
