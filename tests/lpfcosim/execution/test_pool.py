"""What becomes of tasks: done by worker processes or any executor, crashed, killed, late, not done at all."""

import errno
import os
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import Tasks, Workers, dask_executor

posix = pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
REASON = "which function it is"
MODELS = ("Plant", "Actuation")
WHERE = "at 3.0 s, in the Actuation FMU"
INTERNAL = "internal error of lpfcosim, please report it with the traceback; see logs/{}.log"


def act(item, progress):
    """Do as the item says."""
    kind, value = item
    progress.sample, progress.component = 30, 1
    if kind == "signal":
        os.kill(os.getpid(), value)
    elif kind == "raise":
        raise value
    elif kind == "fork":  # a child that has the pipe of its parent, which then sleeps or ends
        if not os.fork() or value == "sleep":
            time.sleep(120)
        os._exit(4)
    elif kind == "function":
        return lambda: value
    elif kind == "wait" and not value.exists():  # to be killed, the first time
        value.with_suffix(".new").write_text(str(os.getpid()))
        value.with_suffix(".new").replace(value)
        time.sleep(60)
    print("done", value)
    return kind, os.environ["OPENBLAS_NUM_THREADS"]


def results(folder, items, **options):
    tasks = Tasks(act, items, folder, folder / "logs", models=MODELS)
    return dict(Workers(**options).results(tasks))


FATES = {
    "crash": (("signal", signal.SIGSEGV), f": its process was ended by SIGSEGV {WHERE}"),
    "parent": (("fork", "sleep"), f": its process was ended at its time limit of 5 s {WHERE}"),
    "child": (("fork", "end"), f": its process ended with status 4 {WHERE}"),
    "item": (("print", lambda: None), " failed: cannot be handed to another process ({reason})"),
    "result": (("function", 1), " failed: its result cannot be handed to another process ({reason})"),
    "value": (("raise", ValueError("cannot reshape")), f" failed: {INTERNAL}"),
    "disk": (
        ("raise", OSError(errno.ENOSPC, "No space left on device", "one.h5")),
        " failed: one.h5: No space left on device; see logs/{}.log",
    ),
}


@posix
def test_a_task_that_fails_is_named_and_takes_no_other_along(tmp_path):
    items = {name: item for name, (item, _) in FATES.items()}
    items |= {"sound": ("print", 1), "sounder": ("print", 2), "refused": ("raise", InputError("no such"))}
    begun = time.monotonic()
    outcomes = results(tmp_path, items, jobs=2, time_limit=5.0)
    assert time.monotonic() - begun < 60
    assert outcomes.pop("sound") == outcomes.pop("sounder") == ("print", "1")
    assert repr(outcomes.pop("refused")) == repr(InputError("no such"))
    for name, (_, sentence) in FATES.items():
        assert isinstance(outcomes[name], RunError)
        expected = f"run '{name}'{sentence.format(name, reason=REASON)}"
        assert re.sub(r"\(.*<lambda>.*\)", f"({REASON})", str(outcomes[name])) == expected
    logs = {path.stem: path.read_text() for path in (tmp_path / "logs").iterdir()}
    assert logs.keys() == {"crash", "value", "disk", "sound", "sounder"}
    assert "Fatal Python error" in logs["crash"]
    assert "Traceback" in logs["value"]
    assert logs["sound"] == "done 1\n"
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]


@posix
def test_other_workers_do_the_work_of_one_that_cannot_be_started(tmp_path, monkeypatch):
    first = tmp_path / "first"
    (tmp_path / "python").write_text(f'#!/bin/sh\nmkdir {first} && exec {sys.executable} "$@"\nexit 1\n')
    (tmp_path / "python").chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    items = dict.fromkeys("ABCD", ("print", 1))
    assert results(tmp_path, items, jobs=2) == dict.fromkeys("ABCD", ("print", "1"))


CALLER = """
import sys
from pathlib import Path
from tests.lpfcosim.execution.test_pool import results
results(Path(sys.argv[1]), {"A": ("wait", Path(sys.argv[1]) / "process")})
"""


def wait_for(path):
    deadline = time.monotonic() + 60
    while not path.exists():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return int(path.read_text())


@posix
def test_workers_end_with_a_caller_that_is_killed(tmp_path):
    with subprocess.Popen([sys.executable, "-c", CALLER, tmp_path]) as caller:
        process = wait_for(tmp_path / "process")
        caller.kill()
    deadline = time.monotonic() + 10
    while Path(f"/proc/{process}").exists() and "\nState:\tZ" not in status(process):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def status(process):
    try:
        return Path(f"/proc/{process}/status").read_text()
    except OSError:
        return "\nState:\tZ"


def test_any_executor_does_the_work(tmp_path, monkeypatch):
    items = {"A": ("print", 1), "B": ("raise", RunError("as asked")), "C": ("raise", ValueError("bad"))}
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    with ThreadPoolExecutor(1) as executor:
        outcomes = results(tmp_path, items, executor=executor)
    assert outcomes["A"] == ("print", "1")
    assert [str(outcomes[name]) for name in "BC"] == ["as asked", "run 'C' failed: ValueError: bad"]


@pytest.mark.slow
@posix
def test_workers_of_a_dask_cluster_that_are_killed_lose_nothing(tmp_path):
    distributed = pytest.importorskip("distributed")
    marks = {name: tmp_path / name for name in "abc"}

    def kill_each_once():
        for mark in marks.values():
            os.kill(wait_for(mark), signal.SIGKILL)

    thread = threading.Thread(target=kill_each_once)
    with distributed.LocalCluster(
        host="127.0.0.1", n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=60
    ) as cluster:
        thread.start()
        items = {name: ("wait", mark) for name, mark in marks.items()}
        with dask_executor(cluster.scheduler_address) as executor:
            outcomes = results(tmp_path, items, executor=executor)
        thread.join()
    assert {name: outcome[0] for name, outcome in outcomes.items()} == dict.fromkeys("abc", "wait")
