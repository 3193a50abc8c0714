"""The co-simulation against the reference plant, and what it does when something goes wrong."""

import os
from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.cosim import co_simulation
from lpfcosim.errors import RunError
from lpfcosim.models import one_axis
from lpfcosim.spacecraft import Authority, HalfCosine, Sine
from tests.agreement import assert_agree
from tests.lpfcosim.cosim import in_memory
from tests.reference_run import simulate_reference

pytestmark = pytest.mark.fmu


def test_six_hours_agree_with_the_reference_plant(fmus, quickstart):
    # Injections and noise on; channels that are zero must be zero exactly.
    run = next(r for r in loading.load(quickstart).runs if r.kind == "sysid")
    assert run.n_samples == 216_000
    got = in_memory.simulate(run, fmus)
    assert set(got) == set(one_axis.MODEL.record)
    assert_agree(got, simulate_reference(run))
    assert np.all(got["f_x_1"] == 0)
    assert got["guidance_o_12"].any()


def test_driven_test_mass_1_agrees_with_the_reference_plant(fmus, make_run):
    run = make_run(
        n_samples=30_000,
        authority=Authority("G", F_max_1=4400e-12, F_max_2=5000e-12, N_max_1=1.5e-12, N_max_2=10.4e-12),
        injections=(
            Sine("F_x_1", amplitude=0.6e-12, frequency=0.02, cycles=20, start=100.05),
            HalfCosine("F_x_1", amplitude=0.4e-9, start=800, end=2800),
            HalfCosine("F_x_2", amplitude=0.4e-9, start=800, end=2800),
        ),
        dc=4e-12,
        noise={
            "oms": 35e-15,
            "f_x_1_jitter": 1e-14,
            "thruster": 1.5e-7,
            "plateau": 5e-15,
            "tail": 1.0,
        },
    )
    got = in_memory.simulate(run, fmus)
    assert_agree(got, simulate_reference(run))
    assert got["f_x_1"].any()


def test_clipped_force_agrees_with_the_reference_plant(fmus, make_run):
    run = make_run(
        authority=Authority("tight", F_max_1=0, F_max_2=2e-12, N_max_1=0, N_max_2=0),
        injections=(Sine("guidance_o_12", amplitude=20e-9, frequency=0.01, cycles=5, start=10),),
    )
    got = in_memory.simulate(run, fmus)
    assert np.abs(got["f_x_2"]).max() == pytest.approx(2e-12 / run.m_tm, rel=1e-12)
    assert_agree(got, simulate_reference(run))


def test_loops_and_block_sizes_give_the_same_bits(fmus, quickstart, monkeypatch):
    run = next(r for r in loading.load(quickstart).runs if r.kind == "sysid")
    run = replace(run, n_samples=2000)
    expected = in_memory.simulate_by_fmpy(run, fmus)
    for block in (co_simulation.BLOCK, 777):
        monkeypatch.setattr(co_simulation, "BLOCK", block)
        got = in_memory.simulate(run, fmus)
        assert all(np.array_equal(got[channel], values) for channel, values in expected.items())


def test_divergence_is_stopped(fmus, make_run):
    # dc beyond what the authority can hold: test mass 2 falls away.
    run = make_run(dc=1e-9, authority=Authority("low", 0, 50e-12, 1e-12, 1e-12))
    with pytest.raises(RunError, match=r"run 'run' diverges: o_12 .* at \d+\.\d s"):
        in_memory.simulate(run, fmus)


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="counts open files through /proc")  # noqa: PTH112
def test_nothing_is_left_behind(fmus, make_run, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    run = make_run(n_samples=10)
    failing = make_run(n_samples=6000, dc=1e-9, authority=Authority("low", 0, 50e-12, 1e-12, 1e-12))
    in_memory.simulate(run, fmus)
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    for _ in range(5):
        in_memory.simulate(run, fmus)
        with pytest.raises(RunError):
            in_memory.simulate(failing, fmus)
    assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208
    assert list(tmp_path.iterdir()) == []
