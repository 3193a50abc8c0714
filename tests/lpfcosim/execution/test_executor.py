"""What becomes of a task that fails in a way that nobody foresaw."""

import errno
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from lpfcosim.errors import RunError
from lpfcosim.execution import Executor, WorkerConfig

CAUSES = {
    "value": ValueError("cannot reshape array of size 3 into shape (2,)"),
    "key": KeyError("o_12"),
    "disk": OSError(errno.ENOSPC, "No space left on device", "one.h5"),
    "bare": OSError("Unable to synchronously create file"),
}
INTERNAL = "internal error of lpfcosim, please report it with the traceback"


def work(cause, fmus, progress):
    progress.set_idle()
    raise CAUSES[cause]


@pytest.mark.parametrize(
    ("cause", "sentence"),
    [("value", INTERNAL), ("key", INTERNAL), ("disk", "one.h5: No space left on device"), ("bare", INTERNAL)],
)
def test_an_unexpected_exception_is_one_sentence_and_a_traceback_in_the_log(tmp_path, cause, sentence):
    config = WorkerConfig(work, tmp_path, tmp_path / "logs")
    ((name, error),) = Executor(1).results(config, {"A": cause}, {})
    assert (name, type(error)) == ("A", RunError)
    assert str(error) == f"run 'A' failed: {sentence}; see logs/A.log"
    log = Path(tmp_path / "logs" / "A.log").read_text()
    assert "Traceback" in log
    assert str(CAUSES[cause]) in log


def leave(name, fmus, progress):
    progress.sample, progress.component = 30, 1
    if name == "leaves":
        os._exit(0)
    return name


def test_a_process_that_ends_with_status_0_is_named_at_once(tmp_path):
    config = WorkerConfig(leave, tmp_path, tmp_path / "logs", models=("Plant", "Actuation"))
    names = {name: name for name in ("leaves", "stays", "also stays")}
    outcomes = dict(Executor(2).results(config, names, {}))
    assert str(outcomes.pop("leaves")) == (
        "run 'leaves': the Actuation FMU ended the process with status 0 at 3.0 s"
    )
    assert outcomes == {"stays": "stays", "also stays": "also stays"}


def wait(mark, fmus, progress):
    progress.set_idle()
    mark.write_text(f"{os.getpid()} {os.getppid()}")
    time.sleep(60)


@pytest.mark.skipif(sys.platform != "linux", reason="forks from a server on Linux only")
def test_workers_end_with_the_server_that_forked_them(tmp_path):
    config, mark = WorkerConfig(wait, tmp_path, tmp_path / "logs"), tmp_path / "mark"

    def kill_server():
        while not mark.exists() or len(mark.read_text().split()) < 2:
            time.sleep(0.05)
        os.kill(int(mark.read_text().split()[1]), signal.SIGKILL)

    thread = threading.Thread(target=kill_server)
    thread.start()
    ((_, error),) = Executor(1).results(config, {"A": mark}, {})
    thread.join()
    assert "its process" in str(error) or "status 255" in str(error)
    deadline = time.monotonic() + 10
    while Path(f"/proc/{mark.read_text().split()[0]}").exists():
        assert time.monotonic() < deadline
        time.sleep(0.1)
