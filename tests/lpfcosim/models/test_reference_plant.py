"""The plant of the reference, its forces and delays, against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lpfcosim.spacecraft.run import Truth
from tests.oracles import reference_plant

H = 0.1
RATIO = 1.928 / 422.7
FREE = {"omega2_1_0": 0.0, "omega2_2_0": 0.0, "alpha_phi_1": 0.0, "alpha_phi_2": 0.0, "alpha_x_2": 0.0}


@pytest.fixture(scope="module")
def bare(make_run):
    """Make a run of which only the plant is used, free of stiffness unless told."""
    return lambda **truth: make_run(truth=Truth(**{**FREE, **truth}))


def advance(run, n, **inputs):
    """Step the plant alone; positions of both test masses at n + 1 samples from equilibrium."""
    plant = reference_plant.plant(run)
    u = np.zeros((n, len(reference_plant.PLANT_INPUTS)))
    for name, values in inputs.items():
        u[:, reference_plant.PLANT_INPUTS.index(name)] = values
    states = np.zeros((n + 1, len(plant.A)))
    for i in range(n):
        states[i + 1] = plant.A @ states[i] + plant.B @ u[i]
    return states[:, 0], states[:, 2]


@given(tau=st.floats(0.05, 0.95), j=st.sampled_from([1, 2]))
def test_command_switches_inside_the_step_exactly(bare, tau, j):
    """A command of one sample issued at t = 3 h acts from 3 h + tau - h/2 on, for one sample."""
    lam, f = 1.05, 1e-10
    run = bare(**{f"lambda_{j}": lam, f"C_{j}": lam * tau})
    n = 30
    command = np.zeros(n)
    command[3] = f
    x = advance(run, n, **{f"f_x_{j}": command})
    t = H * np.arange(n + 1)
    begin = 3 * H + tau - H / 2
    pushed = lam * f / 2 * (np.maximum(t - begin, 0) ** 2 - np.maximum(t - begin - H, 0) ** 2)
    scale = pushed.max()
    np.testing.assert_allclose(x[j - 1], (1 + RATIO) * pushed, atol=1e-12 * scale)
    np.testing.assert_allclose(x[2 - j], RATIO * pushed, atol=1e-12 * scale)
    # far away it looks as if the hold had delayed an impulse by tau, half a sample included
    np.testing.assert_allclose(pushed[-1], lam * f * H * (t[-1] - 3 * H - tau), rtol=1e-9)
