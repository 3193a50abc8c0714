"""Runs on several processes: all there, once, resumed, and honest about failure."""

import multiprocessing as mp
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import replace

import h5py
import numpy as np
import pytest

from lpfcosim import campaign, reference, runner
from lpfcosim.errors import InputError, RunError
from lpfcosim.modelica import build
from lpfcosim.run import Authority, Sine
from tests.campaign_text import ONE_EXPERIMENT

pytestmark = pytest.mark.fmu

PLAN = f"""
schema = "lpf-campaign/1"
name = "short"
seed = 7

{ONE_EXPERIMENT}duration = "200 s"
noise_duration = "100 s"

[[experiments.injections]]
into = "guidance_o_1"
shape = "sine"
frequency = "50 mHz"
amplitude = "1 nm"
cycles = 5
start = "10 s"
"""


@pytest.fixture(scope="module")
def fmus():
    return build.build()


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    file = tmp_path_factory.mktemp("plan") / "short.toml"
    file.write_text(PLAN)
    return campaign.load(file)


@pytest.fixture(scope="module")
def seen():
    """What the simulation of `files` told about its progress."""
    return {}


@pytest.fixture(scope="module")
def files(fmus, plan, tmp_path_factory, seen):
    """The campaign simulated once, by two processes."""
    folder = tmp_path_factory.mktemp("out")
    return runner.simulate(plan, folder, fmus, jobs=2, progress=seen.__setitem__)


def test_files_hold_what_the_reference_plant_computes(plan, files, seen):
    assert [f.name for f in files] == [f"{r.name}.h5" for r in plan.runs]
    assert seen == {r.name: r.n_samples for r in plan.runs}
    for run, file in zip(plan.runs, files, strict=True):
        wanted = reference.simulate(run)
        with h5py.File(file) as telemetry:
            assert telemetry.attrs["campaign_digest"] == plan.digest
            for channel in ("o_1", "o_12", "f_x_2", "F_x_sc"):
                error = np.abs(telemetry[channel][:] - wanted[channel]).max()
                assert error <= 1e-9 * np.sqrt(np.mean(wanted[channel] ** 2)), channel


def test_neither_processes_nor_the_engine_change_a_byte(fmus, plan, files, tmp_path):
    plain = runner.simulate(plan, tmp_path / "plain", fmus, jobs=1, engine="fmpy")
    for a, b in zip(files, plain, strict=True):
        assert a.read_bytes() == b.read_bytes()


def test_finished_runs_are_kept_and_others_are_simulated_again(fmus, plan, files, tmp_path, monkeypatch):
    kept, lost = (tmp_path / "out" / f.name for f in files)
    shutil.copytree(files[0].parent, tmp_path / "out")
    stamp, content = kept.stat().st_mtime_ns, lost.read_bytes()
    lost.write_bytes(content[: len(content) // 2])
    seen, told = set(), []
    runner.simulate(plan, tmp_path / "out", fmus, progress=lambda name, _: seen.add(name), kept=told.append)
    assert (seen, told) == ({lost.stem}, [kept.stem])
    assert kept.stat().st_mtime_ns == stamp
    assert lost.read_bytes() == content
    asked = []
    monkeypatch.setattr(runner, "_simulate_all", lambda tasks, *_: asked.extend(tasks))
    runner.simulate(replace(plan, seed=8), tmp_path / "out", fmus)
    assert asked == [kept.stem, lost.stem]


def test_failing_run_does_not_take_the_others_along(fmus, plan, tmp_path):
    good, bad = plan.runs
    bad = replace(bad, n_samples=6000, dc=1e-9, authority=Authority("low", 0, 50e-12, 1e-12, 1e-12))

    class Plan:
        name, seed, digest, runs = plan.name, plan.seed, plan.digest, (bad, good)

    with pytest.raises(RunError, match=f"run '{bad.name}' diverges"):
        runner.simulate(Plan, tmp_path / "out", fmus, jobs=1)
    assert (tmp_path / "out" / f"{good.name}.h5").is_file()
    assert not (tmp_path / "out" / f"{bad.name}.h5").exists()


def test_a_foreign_file_is_not_ours_whatever_its_attributes(tmp_path):
    path = tmp_path / "one.h5"
    for odd in (np.arange(3), h5py.Empty("f8"), [b"a", b"b"], np.void(b"raw"), np.nan):
        with h5py.File(path, "w") as file:
            file.attrs["seed"] = odd
        assert not runner._is_there(path, {"seed": 7})


def test_a_folder_in_the_place_of_a_file_is_told_first(fmus, plan, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "_simulate_all", None)
    (tmp_path / "one.h5").mkdir()
    with pytest.raises(InputError, match=r"one\.h5: is a folder"):
        runner.simulate(plan, tmp_path, fmus)


def test_what_is_wrong_with_the_fmus_is_said_once(fmus, plan, tmp_path):
    broken = tmp_path / "broken.fmu"
    broken.write_bytes(b"not a zip archive")
    with pytest.raises(InputError) as refusal:
        runner.simulate(plan, tmp_path / "out", {**fmus, "Plant": broken}, jobs=1)
    message = str(refusal.value)
    assert message.startswith(f"{broken}: not a readable FMU")
    assert message.count("broken.fmu") == 1


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """The folder of temporary files, empty."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def long(plan):
    """The campaign with its sysid run so long that something can happen to it."""
    first = plan.experiments[0]
    return replace(plan, experiments=(replace(first, n_samples=65 * 36_000, injections=()),))


def kill_the_workers():
    for worker in mp.active_children():
        os.kill(worker.pid, signal.SIGKILL)


def interrupt():
    raise KeyboardInterrupt


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
@pytest.mark.parametrize(
    ("event", "error", "sentence"),
    [
        (kill_the_workers, RunError, r"^a worker process was killed \(.*\?\); .* continues$"),
        (interrupt, KeyboardInterrupt, "^$"),
    ],
)
def test_what_is_finished_stays_and_nothing_else(fmus, long, tmp_path, scratch, event, error, sentence):
    noise, sysid = (tmp_path / "out" / f"{run.name}.h5" for run in long.runs)

    def progress(name, done):
        if noise.exists() and name == sysid.stem:
            assert not sysid.exists()
            event()

    begun = time.monotonic()
    with pytest.raises(error, match=sentence):
        # the plain loop, which takes minutes
        runner.simulate(long, tmp_path / "out", fmus, jobs=2, engine="fmpy", progress=progress)
    assert time.monotonic() - begun < 30
    assert mp.active_children() == []
    assert list((tmp_path / "out").iterdir()) == [noise]
    assert list(scratch.iterdir()) == []


ORPHANS = """
import sys
from pathlib import Path
from lpfcosim import campaign, runner
from lpfcosim.modelica import build

if __name__ == "__main__":
    plan = campaign.load(Path(sys.argv[1]))
    runner.simulate(plan, Path("out"), build.build(), jobs=2, engine="fmpy")
"""


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
def test_workers_end_with_a_main_process_that_is_killed(tmp_path, scratch):
    (tmp_path / "orphans.py").write_text(ORPHANS)
    (tmp_path / "long.toml").write_text(PLAN.replace("200 s", "65 h").replace("100 s", "65 h"))
    process = subprocess.Popen(
        [sys.executable, "orphans.py", "long.toml"],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(scratch)},
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        begun = time.monotonic()
        while len(list(tmp_path.glob("out/.*.part"))) < 2:
            assert process.poll() is None
            assert time.monotonic() - begun < 60
            time.sleep(0.05)
        process.kill()
        process.communicate(timeout=5)  # until nobody holds its standard error
        assert list((tmp_path / "out").iterdir()) == []
        assert list(scratch.iterdir()) == []
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def test_saturation_is_counted(fmus, make_run, tmp_path):
    quiet = make_run(n_samples=600)
    shaken = make_run(
        n_samples=3000,
        authority=Authority("tight", F_max_1=0, F_max_2=2e-12, N_max_1=0, N_max_2=0),
        injections=(Sine("guidance_o_12", amplitude=20e-9, frequency=0.01, cycles=2, start=10),),
    )
    runner.record(quiet, fmus, tmp_path / "quiet.h5", {})
    runner.record(shaken, fmus, tmp_path / "shaken.h5", {})
    with h5py.File(tmp_path / "shaken.h5") as file:
        expected = int(np.sum(np.abs(file["f_x_2"][:]) >= 2e-12 / shaken.m_tm * (1 - 1e-9)))
    assert expected > 100
    assert runner.saturated([tmp_path / "quiet.h5", tmp_path / "shaken.h5"]) == {"run": expected}
