"""Many runs in one process, one after the other: nothing may pile up.

    pytest -m long tests/hostile/test_endurance.py --runs 2000 -s        prints what is in use on the way

The runs load FMUs of FMI 2.0, of 3.0 and of both. Most of them fail, each in its own way. Once every kind has
come and gone some times, open files, threads, mapped files and temporary folders must stay as they are, and
resident memory may grow by `ALLOWANCE` until the end, however many runs there are: more runs show a smaller
leak. Of 2000 runs 1800 are judged; losing one instance a run, even of the smallest FMU (1.4 kB), is too much.
"""

import gc
import os
from itertools import cycle, islice
from pathlib import Path

import fmpy
import pytest

from lpfcosim.errors import InputError, RunError
from lpfcosim.modelica import build
from lpfcosim.spacecraft.run import Truth
from tests.lpfcosim.cosim import in_memory
from tests.lpfcosim.cosim.archives import repack

PROCESS = Path("/proc/self")
ALLOWANCE = 2048  # kB

pytestmark = [
    pytest.mark.fmu,
    pytest.mark.long,
    pytest.mark.skipif(not (PROCESS / "statm").exists(), reason="reads what is in use from /proc"),
]


def resident_memory():
    """Memory of this process [kB]."""
    return int((PROCESS / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024


def resources():
    """Numbers of open files and of threads, and the mapped files."""
    maps = [line.split(maxsplit=5) for line in (PROCESS / "maps").read_text().splitlines()]
    mapped = frozenset(m[5] for m in maps if len(m) == 6 and m[5].startswith("/"))
    return len(list((PROCESS / "fd").iterdir())), len(list((PROCESS / "task").iterdir())), mapped


@pytest.fixture
def kinds(make_run, tmp_path):
    """Every kind of run: its FMUs, the loop that steps them, the run, and how it fails if it does."""
    good, diverging = make_run(n_samples=20), make_run(n_samples=20, dc=1.0)
    refused = make_run(n_samples=20, truth=Truth(C_2=20.0))  # a delay longer than the FMU keeps
    fmus = build.build()
    token = fmpy.read_model_description(fmus["Plant"]).guid.encode()
    changes = {  # the plant is loaded last, when all others are there to be freed
        "Failed to load shared library": lambda n, b: b"junk" if n.startswith("binaries") else b,
        "is not that of this FMU": lambda n, b: b.replace(token, b"x") if "xml" in n else b,
    }
    cases = [
        (fmus, good, None),
        (fmus, diverging, (RunError, "diverges")),
        (fmus, refused, (RunError, "a delay spans too many communication steps")),
    ]
    for message, change in changes.items():
        broken = repack(fmus["Plant"], tmp_path / f"{len(cases)}.fmu", change)
        cases.append(({**fmus, "Plant": broken}, good, (InputError, message)))
    return cases


def test_nothing_piles_up(kinds, tmp_path, monkeypatch, request):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr("tempfile.tempdir", None)
    runs = request.config.getoption("--runs")
    gc.collect()  # what other tests left behind must not go in the middle of this one
    settled = max(runs // 10, min(3 * len(kinds), runs // 2))
    for done, (fmus, run, failure) in enumerate(islice(cycle(kinds), runs), start=1):
        if failure is None:
            in_memory.simulate(run, fmus)
        else:
            with pytest.raises(failure[0], match=failure[1]):
                in_memory.simulate(run, fmus)
        if done in (settled, runs):
            gc.collect()
        memory, used = resident_memory(), resources()
        if done in (settled, runs // 2, runs):
            print(f"\n{done} runs: {memory} kB, {used[0]} files, {used[1]} threads", end="")
        if done == settled:
            memory_before, used_before = memory, used
        assert list(temporary.iterdir()) == []
        assert done <= settled or used == used_before
    assert memory - memory_before < ALLOWANCE
