"""Building FMUs: archives that no checker faults, the same bytes again, the cache, other compilers."""

import subprocess
import zipfile

import fmpy
import pytest
from fmpy.validation import validate_fmu

from lpfcosim.modelica import build
from lpfcosim.modelica.compiler import compiler

pytestmark = pytest.mark.fmu


@pytest.mark.parametrize("model", build.MODELS)
def test_no_checker_finds_a_fault(model):
    assert validate_fmu(build.build([model])[model]) == []


@pytest.mark.parametrize("model", build.MODELS)
def test_archive_carries_sources_that_compile_without_a_warning(fmus, model, tmp_path):
    if not compiler().command[0].endswith(("cc", "gcc", "clang")):
        pytest.skip("the warning flags are those of gcc and clang")
    with zipfile.ZipFile(fmus[model]) as archive:
        archive.extractall(tmp_path)
    licence = (tmp_path / "documentation" / "licenses" / "license.txt").read_text(encoding="utf-8")
    assert "Redistribution and use" in licence
    sources = sorted((tmp_path / "sources").glob("*.c"))
    names = ("all", "model", "core", "instance", "fmi2")
    assert {f"{name}.c" for name in names} == {p.name for p in sources}
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function", "-fsyntax-only"]
    done = subprocess.run(
        [*compiler().command, *flags, str(tmp_path / "sources" / "all.c")], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


LISA = ("Plant", "Metrology", "DragFreeControl", "SuspensionControl", "PointingControl", "Actuation")


@pytest.mark.parametrize("model", [*build.MODELS, *(f"LISA{part}" for part in LISA)])
def test_every_variable_is_documented(model):
    for v in fmpy.read_model_description(str(build.build([model])[model])).modelVariables:
        assert v.description, v.name
        assert v.unit, v.name
        if v.unit == "m" and v.causality in ("input", "output", "local"):  # motion, not geometry
            assert float(v.nominal) <= 1e-9, v.name


def test_same_sources_give_the_same_bytes(tmp_path):
    first, second = tmp_path / "1" / "Plant.fmu", tmp_path / "2" / "Plant.fmu"
    for archive in (first, second):
        build.build_one(build.PACKAGE, "LISAPathfinder.OneAxis.Plant", archive)
    assert first.read_bytes() == second.read_bytes()


def test_cache_is_used_and_refreshed(tmp_path, monkeypatch):
    monkeypatch.setenv("LPFCOSIM_CACHE", str(tmp_path))
    archive = build.build(["OpticalMetrology"])["OpticalMetrology"]
    stamp = archive.stat().st_mtime_ns
    assert build.build(["OpticalMetrology"])["OpticalMetrology"].stat().st_mtime_ns == stamp
    archive.write_bytes(archive.read_bytes()[:5000])
    assert build.build(["OpticalMetrology"])["OpticalMetrology"].stat().st_size > 5000
