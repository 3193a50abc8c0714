"""Many runs in one process, one after the other: nothing may pile up.

    pytest -m long tests/hostile/test_endurance.py --runs 2000 -s        prints what is in use on the way

The runs load FMUs of FMI 2.0, of 3.0 and of both. Most of them fail, each in its own way. Once every kind has
come and gone some times, open files, threads, mapped files and temporary folders must stay as they are, and
resident memory may grow by `ALLOWANCE` until the end, however many runs there are: more runs show a smaller
leak. Of 2000 runs 1800 are judged; losing one instance a run, even of the smallest FMU (1.4 kB), is too much.
"""

import gc
import os
import time
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path

import fmpy
import pytest

from lpfcosim.errors import InputError, RunError
from lpfcosim.modelica import build
from lpfcosim.spacecraft.run import Truth
from tests.lpfcosim.cosim import in_memory
from tests.lpfcosim.cosim.test_fmu_instance import repack

PROCESS = Path("/proc/self")
ALLOWANCE = 2048  # kB

pytestmark = [
    pytest.mark.fmu,
    pytest.mark.long,
    pytest.mark.skipif(not (PROCESS / "statm").exists(), reason="reads what is in use from /proc"),
]


@dataclass(frozen=True)
class Usage:
    """What this process has in use; numbers of files, threads and mappings, resident memory in kB."""

    memory: int
    files: int
    threads: int
    maps: int
    mapped: frozenset[str]
    folders: tuple[str, ...]

    def __str__(self):
        return (
            f"{self.memory} kB resident, {self.files} open files, {self.threads} threads, "
            f"{self.maps} mappings of {len(self.mapped)} files, {len(self.folders)} temporary folders"
        )


def in_use(temporary):
    maps = [line.split(maxsplit=5) for line in (PROCESS / "maps").read_text().splitlines()]
    pages = int((PROCESS / "statm").read_text().split()[1])
    return Usage(
        memory=pages * os.sysconf("SC_PAGE_SIZE") // 1024,
        files=len(list((PROCESS / "fd").iterdir())),
        threads=len(list((PROCESS / "task").iterdir())),
        maps=len(maps),
        mapped=frozenset(m[5] for m in maps if len(m) == 6 and m[5].startswith("/")),
        folders=tuple(p.name for p in temporary.iterdir()),
    )


@pytest.fixture
def kinds(make_run, tmp_path):
    """Every kind of run: its FMUs, the loop that steps them, the run, and how it fails if it does."""
    two, three = build.build(fmi="2.0"), build.build(fmi="3.0")
    mixed, reverse = ({m: (a, b)[i % 2][m] for i, m in enumerate(a)} for a, b in ((two, three), (three, two)))
    good = make_run(n_samples=20)
    diverging = make_run(n_samples=20, dc=1.0)
    refused = make_run(n_samples=20, truth=Truth(C_2=20.0))  # a delay longer than the FMU keeps
    made = []
    for name, fmus, engine in (
        ("2.0", two, "compiled"),
        ("3.0", three, "fmpy"),
        ("mixed", mixed, "fmpy"),
        ("reverse", reverse, "compiled"),
    ):
        token = fmpy.read_model_description(fmus["Plant"]).guid.encode()

        def junk(file, content):
            return b"junk" if file.startswith("binaries") else content

        def foreign(file, content, token=token):
            return content.replace(token, b"another") if file == "modelDescription.xml" else content

        # The plant is loaded last, when all others are there to be freed.
        no_library = {**fmus, "Plant": repack(fmus["Plant"], tmp_path / f"{name}-library.fmu", junk)}
        no_instance = {**fmus, "Plant": repack(fmus["Plant"], tmp_path / f"{name}-instance.fmu", foreign)}
        made += [
            (fmus, engine, good, None),
            (fmus, engine, diverging, (RunError, "diverges")),
            (fmus, engine, refused, (RunError, "a delay spans too many communication steps")),
            (no_library, engine, good, (InputError, "Failed to load shared library")),
            (no_instance, engine, good, (InputError, "is not that of this FMU")),
        ]
    return made


def test_nothing_piles_up(kinds, tmp_path, monkeypatch, request):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr("tempfile.tempdir", None)
    runs = request.config.getoption("--runs")
    gc.collect()  # what other tests left behind must not go in the middle of this one
    settled = max(runs // 10, min(3 * len(kinds), runs // 2))
    started = time.perf_counter()
    for done, (fmus, engine, run, failure) in enumerate(islice(cycle(kinds), runs), start=1):
        if failure is None:
            in_memory.simulate(run, fmus, engine=engine)
        else:
            with pytest.raises(failure[0], match=failure[1]):
                in_memory.simulate(run, fmus, engine=engine)
        if done in (settled, runs):
            gc.collect()
        now = in_use(temporary)
        if done in (settled, runs // 2, runs):
            print(f"\n{done} runs, {(time.perf_counter() - started) / done:.3f} s each: {now}", end="")
        if done == settled:
            before = now
        assert now.folders == ()
        if done > settled:
            assert (now.files, now.threads, now.mapped) == (before.files, before.threads, before.mapped)
    assert now.memory - before.memory < ALLOWANCE
