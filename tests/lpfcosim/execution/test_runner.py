"""Runs on several processes: all there, once, resumed, and honest about failure."""

import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import h5py
import numpy as np
import pytest

from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import Workers, provenance, runner
from lpfcosim.spacecraft import Authority, Sine
from tests.reference_run import simulate_reference

pytestmark = pytest.mark.fmu


@pytest.fixture(scope="module")
def seen():
    """What the simulation of `files` told about its progress."""
    return {}


@pytest.fixture(scope="module")
def files(fmus, plan, tmp_path_factory, seen):
    """The campaign simulated once, by two processes."""
    folder = tmp_path_factory.mktemp("out")
    done = runner.simulate(
        plan, folder / "telemetry", fmus, runner.RunOptions(2), runner.ProgressCallbacks(seen.__setitem__)
    )
    return list(done.files.values())


def folder_of(path):
    return sorted(p.name for p in path.iterdir())


def test_files_hold_what_the_reference_plant_computes(plan, files, seen):
    assert [f.name for f in files] == [f"{r.name}.h5" for r in plan.runs]
    assert seen == {r.name: r.n_samples for r in plan.runs}
    for run, file in zip(plan.runs, files, strict=True):
        expected = simulate_reference(run)
        with h5py.File(file) as telemetry:
            assert telemetry.attrs["campaign_digest"] == plan.digest
            for channel in ("o_1", "o_12", "f_x_2", "F_x_sc"):
                error = np.abs(telemetry[channel][:] - expected[channel]).max()
                assert error <= 1e-9 * np.sqrt(np.mean(expected[channel] ** 2)), channel


def test_who_does_the_work_does_not_change_a_byte(fmus, plan, files, tmp_path):
    with ThreadPoolExecutor(1) as executor:
        for options in (runner.RunOptions(jobs=1), runner.RunOptions(executor=executor)):
            done = runner.simulate(plan, tmp_path, fmus, replace(options, rerun=True))
            for a, b in zip(files, done.files.values(), strict=True):
                assert a.read_bytes() == b.read_bytes()
            shutil.rmtree(tmp_path)


@pytest.fixture
def copied(files, tmp_path):
    """A copy of what the simulation of `files` left: its two files of telemetry."""
    shutil.copytree(files[0].parent.parent, tmp_path, dirs_exist_ok=True)
    return [tmp_path / "telemetry" / f.name for f in files]


def nothing(_):
    yield from ()


@pytest.fixture
def asked(monkeypatch):
    """The names of the runs that are to be simulated, and are not."""
    queues = []
    monkeypatch.setattr(Workers, "results", lambda _, tasks, __: nothing(queues.append([*tasks.items])))
    return queues


def test_a_byte_changed_anywhere_is_noticed(fmus, plan, copied, asked):
    lost = copied[1]
    content = lost.read_bytes()
    ledger = lost.parent.with_suffix(".sha256").read_text()
    places = [0, 9, len(content) // 3, content.index(b"campaign_digest"), len(content) - 1]
    for place in places:
        lost.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        lost.parent.with_suffix(".sha256").write_text(ledger)
        runner.simulate(plan, lost.parent, fmus)
    assert asked == [[lost.stem]] * len(places)


def test_a_ledger_that_is_lost_or_damaged_costs_time_only(fmus, plan, copied, asked):
    ledger = copied[0].parent.with_suffix(".sha256")
    for damage in (ledger.read_bytes()[40:], b"\xff\0\n  \n", b""):
        ledger.write_bytes(damage)
        runner.simulate(plan, copied[0].parent, fmus)
    assert [{*queue} for queue in asked] == [{"one-noise"}, {"one-noise", "one"}, {"one-noise", "one"}]


@pytest.mark.skipif(os.name != "posix", reason="how a lock shows is that of POSIX")
def test_a_file_that_cannot_be_opened_is_never_replaced(fmus, plan, copied):
    source = f"import h5py; f = h5py.File({str(copied[0])!r}, 'r+'); print('open', flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", source], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout.readline()
        before = [(path.stat().st_ino, path.read_bytes()) for path in copied]
        for options in (runner.RunOptions(), runner.RunOptions(rerun=True)):
            with pytest.raises(InputError, match=rf"{copied[0].name}: cannot be opened"):
                runner.simulate(plan, copied[0].parent, fmus, options)
        assert [(path.stat().st_ino, path.read_bytes()) for path in copied] == before
        holder.communicate(b"\n")
    ledger = copied[0].parent.with_suffix(".sha256")
    ledger.unlink()
    ledger.mkdir()
    with pytest.raises(IsADirectoryError, match=r"telemetry\.sha256"):
        runner.simulate(plan, copied[0].parent, fmus)


def test_what_comes_from_elsewhere_is_refused_or_simulated_anew(fmus, plan, copied, asked, monkeypatch):
    folder = copied[0].parent
    reseeded = replace(plan, seed=8)
    other_fmu = copied[0].parent / "other.fmu"
    other_fmu.write_bytes(fmus["Plant"].read_bytes() + b"0")
    longer = replace(plan, experiments=(replace(plan.experiments[0], duration=200.1),))
    for changed, its, sentence in (
        (reseeded, fmus, "simulated with seed 7, now it is 8"),
        (longer, fmus, "simulated with another version of the campaign"),
        (plan, {**fmus, "Plant": other_fmu}, "simulated with another Plant FMU"),
        (plan, {k: v for k, v in fmus.items() if k != "Plant"}, "simulated with another Plant FMU"),
    ):
        with pytest.raises(InputError, match=rf"one-noise\.h5: {sentence}.*; use another .* \(--rerun; "):
            runner.simulate(changed, folder, its)
    with monkeypatch.context() as patch:
        patch.setattr(provenance.metadata, "version", lambda _: "9.9")
        with pytest.raises(InputError, match=r"one-noise\.h5: simulated with version .*, now it is 9\.9"):
            runner.simulate(plan, folder, fmus)
    assert asked == []
    runner.simulate(reseeded, folder, fmus, runner.RunOptions(rerun=True))
    assert asked == [["one", "one-noise"]]


def test_a_rerun_removes_nothing_before_a_new_file_is_finished_and_then_all_that_is_old(
    fmus, plan, copied, monkeypatch
):
    folder, reseeded = copied[0].parent, replace(plan, seed=8)
    before = {path: path.read_bytes() for path in copied}
    rerun = runner.RunOptions(1, rerun=True)
    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", str(folder / "no-python"))
        with pytest.raises(RunError, match="no worker process can be started"):
            runner.simulate(reseeded, folder, fmus, rerun)
    broken = dict.fromkeys(fmus, folder.parent / "broken.fmu")
    broken["Plant"].write_bytes(b"no FMU")
    with pytest.raises(InputError, match=r"broken\.fmu"):
        runner.simulate(reseeded, folder, broken, rerun)
    assert {path: path.read_bytes() for path in copied} == before

    def interrupt(_name, done):
        if done >= 2000:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        runner.simulate(reseeded, folder, fmus, rerun, runner.ProgressCallbacks(interrupt))
    (file,) = folder.glob("*.h5")
    assert file.read_bytes() != before[file]
    assert not runner.simulate(reseeded, folder, fmus).failures


def test_an_interrupt_leaves_what_is_finished_and_nothing_else(fmus, plan, tmp_path, monkeypatch):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    experiment = replace(plan.experiments[0], duration=65 * 3600.0, injections=())
    long = replace(plan, experiments=(experiment,))
    noise, sysid = (tmp_path / "telemetry" / f"{run.name}.h5" for run in long.runs)

    def progress(name, done):
        if noise.exists() and name == sysid.stem:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        runner.simulate(long, noise.parent, fmus, runner.RunOptions(2), runner.ProgressCallbacks(progress))
    assert folder_of(noise.parent) == [noise.name]
    assert list(scratch.iterdir()) == []


def test_saturation_is_counted(fmus, make_run, tmp_path):
    quiet = make_run(n_samples=600)
    shaken = make_run(
        n_samples=3000,
        authority=Authority("tight", F_max_1=0, F_max_2=2e-12, N_max_1=0, N_max_2=0),
        injections=(Sine("guidance_o_12", amplitude=20e-9, frequency=0.01, cycles=2, start=10),),
    )
    runner.write_telemetry(quiet, fmus, tmp_path / "quiet.h5", {})
    runner.write_telemetry(shaken, fmus, tmp_path / "shaken.h5", {})
    with h5py.File(tmp_path / "shaken.h5") as file:
        expected = int(np.sum(np.abs(file["f_x_2"][:]) >= 2e-12 / shaken.m_tm * (1 - 1e-9)))
    assert expected > 100
    assert runner.saturated_samples([tmp_path / "quiet.h5", tmp_path / "shaken.h5"]) == {"run": expected}


def test_telemetry_of_no_run_of_the_campaign_is_left_alone(fmus, plan, tmp_path):
    stranger = tmp_path / "telemetry" / "two.h5"
    stranger.parent.mkdir()
    stranger.write_bytes(b"somebody's")
    with pytest.raises(InputError, match=r"two\.h5: belongs to no run of this campaign; choose"):
        runner.simulate(plan, stranger.parent, fmus)
    assert folder_of(stranger.parent) == ["two.h5"]
    stranger.unlink()
    stranger.with_name("one.h5").mkdir()
    with pytest.raises(InputError, match=r"one\.h5: cannot be opened \(Is a directory"):
        runner.simulate(plan, stranger.parent, fmus)
