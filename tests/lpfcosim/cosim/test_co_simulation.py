"""The co-simulation against reference plant and equations, and what it does when something goes wrong."""

import os
from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.cosim import co_simulation
from lpfcosim.errors import RunError
from lpfcosim.linear import ClosedLoop
from lpfcosim.modelica import build
from lpfcosim.models import model_of, one_axis
from lpfcosim.spacecraft import Authority, HalfCosine, Sine
from tests.agreement import assert_agree
from tests.lpfcosim.cosim import in_memory
from tests.reference_run import simulate_reference

pytestmark = pytest.mark.fmu


LEVELS = {
    "oms": 35e-15, "thruster": 0.15e-6, "plateau": 5.6e-15, "tail": 1.5, "f_x_1_jitter": 1e-14,
    "electrode": 2e-4, "electrode_common": 1e-4,
}  # fmt: skip
WHOLE_LEVELS = {
    "dws": 2e-10, "grs": 2e-9, "grs_angle": 1e-7, "nozzles": 0.15e-6, "torque": 1e-12, "lateral": 1e-14,
    "star_tracker_theta": 2.0, "star_tracker_eta": 0.2, "star_tracker_phi": 0.13e-3,
}  # fmt: skip
WHOLE_TRUTH = {
    "delta_phi": -0.47e-3, "delta_eta": -0.066e-3,
    "b_1": 1.2e-5, "b_2": -0.9e-5, "b_3": 2.2e-5, "b_4": -1.8e-5, "b_5": 1e-7, "b_6": -1e-7,
    "Omega_theta_start": 1e-7, "Omega_eta_start": 4e-8, "Omega_phi_start": 2e-7,
    "lambda_N": 1.01, "leak_phi_1": 40.0, "kappa_phi": 1e-3, "kappa_eta": -2e-3,
    "omega2_eta_0": -1.4e-6, "omega2_phi_0": -1.3e-6,
}  # fmt: skip


def test_an_hour_agrees_with_the_reference_plant(fmus, quickstart):
    # Injections and noise on; channels that are zero must be zero exactly.
    run = next(r for r in loading.load(quickstart).runs if r.kind == "sysid")
    run = replace(run, n_samples=36_000)
    got = in_memory.simulate(run, fmus)
    assert set(got) == set(one_axis.MODEL.record)
    assert_agree(got, simulate_reference(run))
    assert np.all(got["f_x_1"] == 0)
    assert got["guidance_o_12"].any()


@pytest.mark.parametrize("whole", [False, True])
def test_fmus_and_equations_agree_on_everything_at_once(make_run, whole):
    """Louder than in flight, to show within minutes; the star tracker takes forces to their limits."""
    run = make_run(
        n_samples=3000,
        authority=Authority("G", F_max_1=4400e-12, F_max_2=5000e-12, N_max_1=1.5e-12, N_max_2=10.4e-12),
        dc=1e-11,
        injections=(
            Sine("guidance_o_12", 10e-9, 20e-3, 4, 10.0),
            Sine("guidance_o_1", 5e-9, 30e-3, 3, 30.0),
            HalfCosine("F_x_1", 5000e-12, 20.0, 200.0),
            HalfCosine("F_x_2", 4000e-12, 20.0, 200.0),
        ),
        **({"spacecraft": "lpf", "truth": WHOLE_TRUTH} if whole else {}),
        noise=LEVELS | (WHOLE_LEVELS if whole else {}),
    )
    got = in_memory.simulate(run, build.build(model_of(run).models))
    expected = ClosedLoop(run).simulate()
    assert set(got) == set(model_of(run).record)
    assert_agree(got, expected)
    assert np.abs(got["f_x_1"]).max() == pytest.approx(4400e-12 / run.m_tm, rel=1e-2)
    quiet = ClosedLoop(run.without_noise("electrode", "electrode_common")).simulate()
    assert np.abs(quiet["o_12"] - got["o_12"]).max() > 1e-4 * np.abs(got["o_12"]).max()
    if whole:
        assert np.abs(got["F_z_1"]).max() == pytest.approx(50e-12, rel=1e-12, abs=0)


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
