"""Building FMUs: archives that no checker faults, the same bytes again, the cache, other compilers."""

import subprocess
import zipfile

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


def test_same_sources_give_the_same_bytes(tmp_path):
    first, second = tmp_path / "1" / "Plant.fmu", tmp_path / "2" / "Plant.fmu"
    for archive in (first, second):
        build.build_one(build.PACKAGE, "LISAPathfinder.OneAxis.Plant", archive)
    assert first.read_bytes() == second.read_bytes()
