"""One process at a time on a folder; what dead ones left goes, what a living one writes stays."""

import os
import signal
import subprocess
import sys

import pytest

from fit.files import atomic
from lpfcosim.errors import InputError
from lpfcosim.execution import results_folder as folders

HOLD = """
import sys, time
from pathlib import Path
from fit.files import atomic
from lpfcosim.execution import checksums as files
from lpfcosim.execution import results_folder as folders


folder = Path(sys.argv[1])
with folders.lock(folder), files.temporary_folder(folder) as scratch:
    atomic.temporary(folder / "results.json").write_text("half")
    (folder / "telemetry").mkdir()
    atomic.temporary(folder / "telemetry" / "A.h5").write_text("half")
    (scratch / "library.so").write_text("unpacked")
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def other(tmp_path):
    """Another process that works in ``tmp_path / "out"``, and its unfinished files."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "out")], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def names(folder):
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*")} - {".lock"}


def test_the_second_learns_who_is_first_and_touches_nothing(other, tmp_path):
    before = names(tmp_path / "out")
    holder = (
        rf"out: another process works in it \(process {other.pid} on .*; wait for it or choose another fo"
    )
    with pytest.raises(InputError, match=holder), folders.lock(tmp_path / "out", alternative=True):
        pass
    assert names(tmp_path / "out") == before
    assert len(before) == 6


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
def test_a_lock_does_not_outlive_its_holder_nor_do_unfinished_files(other, tmp_path):
    other.send_signal(signal.SIGKILL)
    other.wait()
    somebodys = {"telemetry/.film.part", "telemetry/.film.b.part", "mine/.film.1.part"}
    (tmp_path / "out" / "mine").mkdir()
    for name in somebodys:
        (tmp_path / "out" / name).write_text("")
    with folders.lock(tmp_path / "out"):
        assert names(tmp_path / "out") == {"telemetry", "mine", ".lock-holder", *somebodys}
        assert str(os.getpid()) in (tmp_path / "out" / ".lock-holder").read_text()
    assert names(tmp_path / "out") == {"telemetry", "mine", *somebodys}
    with folders.lock(tmp_path / "out"):  # and again, and within
        half = atomic.temporary(tmp_path / "out" / "results.json")
        half.write_text("half")
        with folders.lock(tmp_path / "out" / ".." / "out"):
            assert half.exists()
        second = [sys.executable, "-c", HOLD, str(tmp_path / "out")]
        done = subprocess.run(second, capture_output=True, text=True, check=False)
        assert "another process works in it" in done.stderr
