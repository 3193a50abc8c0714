"""FMUs that come as sources: compiled once, for this platform, and what does not compile."""

from pathlib import Path

import fmpy
import numpy as np
import pytest

from lpfcosim.cosim import compatibility, compilation, warnings
from lpfcosim.errors import InputError
from tests import third_party
from tests.lpfcosim.cosim.archives import edited
from tests.lpfcosim.cosim.third_party_fmu import FMI, MODEL, placed, refusal, replacement, simulate

pytestmark = [pytest.mark.fmu]


@FMI
def test_sources_are_compiled_once(run, fmus, tmp_path, monkeypatch, fmi):
    monkeypatch.setenv("LPFCOSIM_CACHE", str(tmp_path / "cache"))
    expected = simulate(run, fmus, third_party.built(tmp_path, fmi=fmi))
    archive = third_party.built(tmp_path, sources=True, fmi=fmi, name="source")
    _, result = placed(run, fmus, replacement(archive))
    assert "its sources are compiled" in warnings(result)[0]
    got = simulate(run, fmus, archive)
    assert all(np.array_equal(got[channel], values) for channel, values in expected.items())
    (library,) = (tmp_path / "cache" / "compiled").glob(f"*/*{fmpy.sharedLibraryExtension}")
    before = library.stat().st_mtime_ns
    simulate(run, fmus, archive)
    assert library.stat().st_mtime_ns == before


def test_sources_are_compiled_anew_with_other_flags(run, fmus, tmp_path, monkeypatch):
    monkeypatch.setenv("LPFCOSIM_CACHE", str(tmp_path / "cache"))
    archive = third_party.built(tmp_path, sources=True, fmi="3.0", name="source")
    _, interfaces = placed(run, fmus, replacement(archive))
    description = next(i.description for i in interfaces if i.model == MODEL)
    before = compilation.compiled(archive, description, archive)
    monkeypatch.setattr(compilation, "_FLAGS", (*compilation._FLAGS, "-O1"))
    assert compilation.compiled(archive, description, archive) != before


def test_sources_that_do_not_compile(run, fmus, tmp_path, monkeypatch):
    monkeypatch.setenv("LPFCOSIM_CACHE", str(tmp_path / "cache"))
    archive = third_party.built(tmp_path, "step=(", sources=True)
    with pytest.raises(
        InputError, match=r"ThirdParty\.fmu: its sources do not compile with .*error.*; see "
    ) as refused:
        simulate(run, fmus, archive)
    assert "error" in Path(str(refused.value).rpartition("see ")[2]).read_text()
    monkeypatch.setenv("CC", "no-such-compiler")
    compatibility.compilation.compiler.compiler.cache_clear()
    with pytest.raises(InputError, match=r"has sources but no binary for .*'no-such-compiler', is not there"):
        simulate(run, fmus, archive)
    compatibility.compilation.compiler.compiler.cache_clear()


@pytest.mark.parametrize(
    ("listed", "said"),
    [
        ("slave.f90", 'has no binary for this platform, and sources: "slave.f90"; expected C or C++'),
        ("other.c", "sources/other.c: is missing, which its description lists"),
    ],
)
def test_sources_that_are_not_there_or_of_another_language(run, fmus, tmp_path, listed, said):
    archive = third_party.built(tmp_path, sources=True)
    changed = edited(archive, tmp_path / "changed.fmu", (r"slave\.c", listed))
    assert refusal(run, fmus, changed).endswith(said)
