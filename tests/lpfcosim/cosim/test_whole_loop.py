"""The whole spacecraft through its eight FMUs, against the reference plant."""

from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.linear import ClosedLoop
from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Authority, Sine
from tests.agreement import assert_agree
from tests.lpfcosim.cosim import in_memory

pytestmark = pytest.mark.fmu

TRUTH = {
    "delta_phi": -0.47e-3, "delta_eta": -0.066e-3,
    "b_1": 1.2e-5, "b_2": -0.9e-5, "b_3": 2.2e-5, "b_4": -1.8e-5, "b_5": 1e-7, "b_6": -1e-7,
    "Omega_theta_start": 1e-7, "Omega_eta_start": 4e-8, "Omega_phi_start": 2e-7,
    "lambda_N": 1.01, "leak_phi_1": 0.01, "kappa_phi": 1e-3, "kappa_eta": -2e-3,
    "omega2_eta_0": -1.4e-6, "omega2_phi_0": -1.3e-6,
}  # fmt: skip
NOISE = {
    "oms": 35e-15, "nozzles": 0.15e-6, "plateau": 5.6e-15, "tail": 1.5, "f_x_1_jitter": 1e-14, "dws": 150e-12,
    "grs": 1.8e-9, "grs_angle": 120e-9, "star_tracker_theta": 0.6e-3, "star_tracker_eta": 0.6e-3,
    "star_tracker_phi": 0.13e-3, "lateral": 1e-14, "torque": 1.5e-12,
}  # fmt: skip


@pytest.fixture
def run(make_run):
    return make_run(
        n_samples=20_000,
        spacecraft="lpf",
        truth=TRUTH,
        noise=NOISE,
        dc=4e-12,
        authority=Authority("G", F_max_1=4400e-12, F_max_2=5000e-12, N_max_1=1.5e-12, N_max_2=10.4e-12),
        injections=(
            Sine("guidance_o_12", amplitude=10e-9, frequency=0.01, cycles=10, start=100),
            Sine("guidance_o_1", amplitude=5e-9, frequency=0.03, cycles=10, start=300),
            Sine("F_x_1", amplitude=0.6e-12, frequency=0.02, cycles=20, start=500),
        ),
    )


def built(run):
    return build.build(model_of(run).models)


def test_agrees_with_the_reference_plant(run):
    got, expected = in_memory.simulate(run, built(run)), ClosedLoop(run).simulate()
    assert set(got) == set(model_of(run).record)
    assert_agree(got, expected)
    assert np.abs(got["f_x_1"]).max() > 0


def test_authority_agrees_with_the_reference_plant(run):
    # Star tracker far off at first: the lateral forces and the torque about x stay at their limits.
    shaken = replace(run, noise=NOISE | {"star_tracker_eta": 0.2, "star_tracker_theta": 2.0}, n_samples=6000)
    got, expected = in_memory.simulate(shaken, built(run)), ClosedLoop(shaken).simulate()
    assert np.abs(got["F_z_1"]).max() == pytest.approx(50e-12, rel=1e-12)
    assert_agree(got, expected)
