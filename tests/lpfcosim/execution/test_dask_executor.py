"""Work on a Dask cluster: a real scheduler and real workers on loopback, some of which are killed."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import dask_executor
from tests.lpfcosim.cli.test_montecarlo import SMALL

pytestmark = pytest.mark.long

distributed = pytest.importorskip("distributed", reason="needs the extra dask")


def work(item, files, progress):
    """Do as the item says; executed by the workers."""
    if item == "fail":
        raise RunError("as asked")
    if item == "die":
        os._exit(11)
    if isinstance(item, Path):  # be killed here, the first time
        if not item.exists():
            item.write_text(str(os.getpid()))
            time.sleep(60)
        item = "survived"
    return item, {name: (path.suffix, path.read_bytes()) for name, path in files.items()}


@pytest.fixture(scope="module")
def address():
    with distributed.LocalCluster(
        host="127.0.0.1", n_workers=2, threads_per_worker=2, dashboard_address=":0", silence_logs=60
    ) as local:
        yield local.scheduler_address


@pytest.fixture
def files(tmp_path):
    (tmp_path / "one.fmu").write_bytes(b"\0one")
    (tmp_path / "again.fmu").write_bytes(b"\0one")
    return {"A": tmp_path / "one.fmu", "B": tmp_path / "again.fmu"}


def test_results_come_by_name(address, files):
    items = {f"run {k}": k for k in range(20)}
    result = dict(dask_executor.results(address, work, items, files))
    sent = {"A": (".fmu", b"\0one"), "B": (".fmu", b"\0one")}
    assert result == {name: (k, sent) for name, k in items.items()}


def test_an_error_is_a_result_and_the_others_go_on(address):
    result = dict(dask_executor.results(address, work, {"bad": "fail", "good": 2}, {}))
    assert result["good"] == (2, {})
    assert isinstance(result["bad"], RunError)
    assert str(result["bad"]) == "as asked"


def test_workers_killed_are_made_good(address, tmp_path, files):
    marks = {name: tmp_path / name for name in "abc"}
    reaper = threading.Thread(target=kill, args=(list(marks.values()),))
    reaper.start()
    found = dict(dask_executor.results(address, work, marks | {"d": 4}, files))
    reaper.join()
    assert {name: result[0] for name, result in found.items()} == dict.fromkeys("abc", "survived") | {"d": 4}
    assert all(result[1].keys() == files.keys() for result in found.values())


def kill(marks):
    """Kill every worker once that waits for it."""
    deadline = time.monotonic() + 60
    while marks and time.monotonic() < deadline:
        for mark in [m for m in marks if m.exists() and m.read_text()]:
            os.kill(int(mark.read_text()), signal.SIGKILL)
            marks.remove(mark)
        time.sleep(0.05)


def test_what_kills_every_worker_is_named(address):
    result = dict(dask_executor.results(address, work, {"fatal": "die"}, {}))
    assert str(result["fatal"]).startswith("fatal: every worker that took it on died")


def test_another_version_is_refused(address, monkeypatch):
    monkeypatch.setattr(dask_executor, "_versions", lambda: {"lpfcosim": "9.9", "numpy": "1", "scipy": "1"})
    ((_, error),) = dask_executor.results(address, work, {"one": 1}, {})
    assert "expected 9.9 as where the command runs" in str(error)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "tcp://nowhere.invalid:8786"])
def test_no_scheduler_is_one_sentence(address):
    with pytest.raises(InputError, match="no Dask scheduler answers there, expected one such as"):
        list(dask_executor.results(address, work, {"one": 1}, {}))


def test_a_scheduler_lost_is_told(tmp_path):
    told = tmp_path / "scheduler.json"
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(told)]
    scheduler = subprocess.Popen([*command, *options], stderr=subprocess.DEVNULL)
    try:
        while not told.exists() or not told.stat().st_size:
            assert scheduler.poll() is None
            time.sleep(0.05)
        result = json.loads(told.read_text(encoding="utf-8"))["address"]
        with pytest.raises(RunError, match="scheduler is lost"):
            threading.Timer(1.0, scheduler.kill).start()
            list(dask_executor.results(result, work, {"one": 1}, {}))  # there is no worker to do it
    finally:
        scheduler.kill()
        scheduler.wait()


def kill_workers(address, log, kills, first):
    """Kill a worker once a file has its `first` lines, and another after every seven more."""
    with distributed.Client(address, set_as_default=False) as client:
        for kill in range(kills):
            while not log.exists() or len(log.read_text(encoding="utf-8").splitlines()) < first + 7 * kill:
                time.sleep(0.02)
            processes = list(client.run(os.getpid, on_error="ignore").values())
            os.kill(processes[kill % len(processes)], signal.SIGKILL)


@pytest.mark.fmu
def test_run_is_that_of_one_process_though_workers_die(address, tmp_path, lpfcosim):
    (tmp_path / "two.toml").write_text(SMALL, encoding="utf-8")
    command = ("run", "two.toml", "--quiet")
    alone = lpfcosim(*command, "--out", "alone", "--jobs", 1)
    ledger = tmp_path / "spread" / "telemetry.sha256"
    killer = threading.Thread(target=kill_workers, args=(address, ledger, 1, 1))
    killer.start()
    spread = lpfcosim(*command, "--out", "spread", "--scheduler", address)
    killer.join()
    assert spread == alone
    assert spread[0] == 0
    for name in ("one.h5", "one-noise.h5"):
        first, second = (tmp_path / folder / "telemetry" / name for folder in ("alone", "spread"))
        assert first.read_bytes() == second.read_bytes()
    first, second = (
        json.loads((tmp_path / folder / "results.json").read_text(encoding="utf-8"))
        for folder in ("alone", "spread")
    )
    assert first == second
