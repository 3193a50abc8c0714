"""The closed loop that is made from the equations of the models."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import lpfcosim
from lpfcosim.linear.closed_loop import ClosedLoop
from lpfcosim.models import stimuli
from lpfcosim.spacecraft import Authority, Sine
from tests.reference_run import simulate_reference

NOISE = {"oms": 3e-15, "thruster": 5e-8, "plateau": 6e-15, "tail": 1.0, "f_x_1_jitter": 1e-15}
NOISE |= {
    "dws": 1e-10,
    "grs": 1e-9,
    "grs_angle": 1e-7,
    "thruster_torque": 1e-8,
    "torque": 1e-13,
    "lateral": 1e-13,
}
WHOLE = {
    "delta_phi": 1e-3, "leak_phi_1": 1e-2,
    "b_1": 1e-4, "b_2": 2e-4, "b_3": 1e-5, "b_4": 2e-5, "b_5": 1e-9, "b_6": 2e-9,
    "Omega_theta_start": 1e-6, "Omega_eta_start": 2e-6, "Omega_phi_start": 3e-6,
}  # fmt: skip
CRAFTS = [{"spacecraft": "lpf-x"}, {"spacecraft": "lpf", "truth": WHOLE}]


@pytest.fixture
def driven(make_run):
    into = (("guidance_o_1", 1e-8), ("guidance_o_12", 5e-9), ("F_x_1", 1e-12), ("F_x_2", 5e-10))
    injections = tuple(Sine(name, size, 0.01 * k, 2, 5.0) for k, (name, size) in enumerate(into, 1))
    return partial(make_run, n_samples=1500, noise=NOISE, dc=1e-10, injections=injections)


def deviations(computed, expected):
    """Return the largest deviation of each channel in units of its rms."""
    return {
        name: float(np.abs(computed[name] - x).max() / np.sqrt(np.mean(x**2)))
        for name, x in expected.items()
        if x.any()
    }


def test_simulation_is_that_of_the_reference_plant(driven):
    authority = Authority("wide", 1e-9, 2.2e-9, 1e-11, 1e-11)
    run = driven(authority=authority, noise={**NOISE, "electrode": 1e-6})
    result = deviations(ClosedLoop(run).simulate(), simulate_reference(run))
    assert max(result.values()) < 1e-12, result


def test_commands_at_their_limit_are_those_of_the_reference_plant(driven):
    run = driven(authority=Authority("narrow", 1e-12, 4e-10, 1e-11, 1e-11))
    expected = simulate_reference(run)
    assert np.mean(np.abs(expected["f_x_2"]) >= 0.999 * np.abs(expected["f_x_2"]).max()) > 0.05
    assert max(deviations(ClosedLoop(run).simulate(), expected).values()) < 1e-12


@pytest.mark.parametrize("spacecraft", CRAFTS)
def test_linear_loop_predicts_small_departures(driven, spacecraft):
    run = replace(driven(**spacecraft), injections=(), noise={}, dc=0.0)
    loop = ClosedLoop(run)
    system, steady = loop.linearize(), stimuli.injections(run)
    equilibrium = loop.simulate(steady)
    for name, size in (("g_2", 1e-13), ("guidance_o_1", 1e-10), ("F_noise_x_sc", 1e-8), ("F_x_2", 1e-12)):
        pulse = np.zeros(run.n_samples)
        pulse[100:200] = size
        moved = loop.simulate({**steady, name: pulse})
        state, expected = np.zeros(len(system.A)), np.empty((run.n_samples, len(system.outputs)))
        column = system.inputs.index(name)
        for n, u in enumerate(pulse):
            expected[n] = system.C @ state + system.D[:, column] * u
            state = system.A @ state + system.B[:, column] * u
        for channel in ("o_1", "o_12", "f_x_2", "F_x_sc"):
            x = expected[:, system.outputs.index(channel)]
            np.testing.assert_allclose(
                moved[channel] - equilibrium[channel], x, rtol=0, atol=1e-4 * np.abs(x).max()
            )


@pytest.mark.parametrize("spacecraft", CRAFTS)
def test_frequency_response_leaves_delays_out_of_the_solution(driven, spacecraft):
    system = ClosedLoop(driven(**spacecraft)).linearize()
    system = system.select(("guidance_o_1", "F_x_2", "g_2"), ("o_1", "o_12", "f_x_2", "F_x_sc"))
    frequency = np.array([1e-3, 0.05, 2.0])
    z = np.exp(2j * np.pi * frequency * system.dt)
    expected = [
        system.C @ np.linalg.solve(k * np.eye(len(system.A)) - system.A, system.B) + system.D for k in z
    ]
    result = system.frequency_response(frequency)
    np.testing.assert_allclose(result, expected, rtol=1e-7)
    assert len(system._memory) > len(system.A) // 3


def test_loop_of_a_run_has_names_units_and_sample_time(quickstart):
    campaign = lpfcosim.load_campaign(quickstart)
    system = lpfcosim.closed_loop(campaign, campaign.runs[1].name).linearize()
    assert system.dt == 0.1
    assert system.B.shape == (len(system.A), len(system.inputs))
    assert system.C.shape == (len(system.outputs), len(system.A))
    assert (system.units["guidance_o_12"], system.units["f_x_2"]) == ("m", "m/s2")
    assert np.abs(system.poles()).max() < 1


def test_gain_of_noise_takes_the_command_it_multiplies(driven):
    run = driven(noise={**NOISE, "electrode": 1e-6})
    loop = ClosedLoop(run)
    idle, busy = loop.linearize(), loop.linearize({"f_x_1": 3e-10})
    column = idle.inputs.index("gain_1")
    assert not idle.B[:, column].any()
    assert busy.B[:, column].max() == pytest.approx(3e-10 * run.truth["lambda_1"], rel=1e-6, abs=0)
