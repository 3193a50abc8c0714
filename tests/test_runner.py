"""Runs on several processes: all there, once, resumed, and honest about failure."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from lpfcosim import campaign, reference, runner
from lpfcosim.errors import RunError
from lpfcosim.modelica import build
from lpfcosim.run import Authority

pytestmark = pytest.mark.fmu

PLAN = """
schema = "lpf-campaign/1"
name = "short"
seed = 7

[noise]
oms = "35 fm Hz^-0.5"
thruster = "0.15 uN Hz^-0.5"
plateau = "5.6 fm s^-2 Hz^-0.5"
tail = 1.5

[authority.A]
F_max_1 = "0 pN"
F_max_2 = "2200 pN"
N_max_1 = "10.4 pN m"
N_max_2 = "10.4 pN m"

[[experiments]]
name = "one"
authority = "A"
alignment_epoch = 1
duration = "200 s"
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


@pytest.fixture
def plan(tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(PLAN)
    return campaign.load(file)


def test_files_hold_what_the_reference_plant_computes(fmus, plan, tmp_path):
    seen = {}
    files = runner.simulate(plan, tmp_path / "out", fmus, jobs=2, progress=seen.__setitem__)
    assert [f.name for f in files] == [f"{r.name}.h5" for r in plan.runs]
    assert seen == {r.name: r.n_samples for r in plan.runs}
    for run, file in zip(plan.runs, files, strict=True):
        wanted = reference.simulate(run)
        with h5py.File(file) as telemetry:
            assert telemetry.attrs["campaign_digest"] == plan.digest
            for channel in ("o_1", "o_12", "f_x_2", "F_x_sc"):
                error = np.abs(telemetry[channel][:] - wanted[channel]).max()
                assert error <= 1e-9 * np.sqrt(np.mean(wanted[channel] ** 2)), channel


def test_number_of_processes_changes_no_byte(fmus, plan, tmp_path):
    one = runner.simulate(plan, tmp_path / "one", fmus, jobs=1)
    two = runner.simulate(plan, tmp_path / "two", fmus, jobs=2)
    for a, b in zip(one, two, strict=True):
        assert a.read_bytes() == b.read_bytes()


def test_finished_runs_are_kept_and_others_are_simulated_again(fmus, plan, tmp_path):
    files = runner.simulate(plan, tmp_path / "out", fmus)
    kept, lost = files
    stamp, content = kept.stat().st_mtime_ns, lost.read_bytes()
    lost.write_bytes(content[: len(content) // 2])
    runner.simulate(plan, tmp_path / "out", fmus)
    assert kept.stat().st_mtime_ns == stamp
    assert lost.read_bytes() == content
    runner.simulate(replace(plan, seed=8), tmp_path / "out", fmus)
    assert kept.stat().st_mtime_ns != stamp


def test_failing_run_does_not_take_the_others_along(fmus, plan, tmp_path):
    good, bad = plan.runs
    bad = replace(bad, n_samples=6000, dc=1e-9, authority=Authority("low", 0, 50e-12, 1e-12, 1e-12))

    class Plan:
        name, seed, digest, runs = plan.name, plan.seed, plan.digest, (bad, good)

    with pytest.raises(RunError, match=f"run '{bad.name}' diverges"):
        runner.simulate(Plan, tmp_path / "out", fmus, jobs=1)
    assert (tmp_path / "out" / f"{good.name}.h5").is_file()
    assert not (tmp_path / "out" / f"{bad.name}.h5").exists()
