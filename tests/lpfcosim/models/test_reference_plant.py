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


def test_free_particle_falls_on_a_parabola(bare):
    t = H * np.arange(1001)
    x_1, x_2 = advance(bare(), 1000, g_1=3e-12)
    np.testing.assert_allclose(x_1, 0.5 * 3e-12 * (1 + RATIO) * t**2, rtol=1e-12)
    np.testing.assert_allclose(x_2, 0.5 * 3e-12 * RATIO * t**2, rtol=1e-12)  # the spacecraft recoils


@pytest.mark.parametrize("stiffness", [4e-2, 4e-7, -4e-7, -4e-4])
def test_oscillator_or_exponential(bare, stiffness):
    """With equal stiffness the differential mode has rate w, the common one (1 + 2 m/M) w, eq. of motion."""
    t = H * np.arange(2001)
    run = bare(omega2_1_0=stiffness, omega2_2_0=stiffness)
    x_1, x_2 = advance(run, 2000, g_1=1e-12, g_2=-4e-12)

    def forced(rate, g):  # x'' = -rate x + g from rest
        root = np.sqrt(complex(rate))
        return (2 * g / rate * np.sin(root * t / 2) ** 2).real

    difference, total = (
        forced(stiffness, -5e-12),
        forced(stiffness * (1 + 2 * RATIO), -3e-12 * (1 + 2 * RATIO)),
    )
    np.testing.assert_allclose(x_2 - x_1, difference, rtol=1e-9, atol=1e-11 * np.abs(difference).max())
    np.testing.assert_allclose(x_1 + x_2, total, rtol=1e-9, atol=1e-11 * np.abs(total).max())


def test_internal_forces_leave_the_barycentre_alone(bare):
    rng = np.random.default_rng(1)
    n = 400
    g = rng.standard_normal((2, n)) * 1e-12
    x = advance(bare(), n, g_1=g[0], g_2=g[1])
    velocity = np.hstack([np.zeros((2, 1)), H * np.cumsum(g, axis=1)])  # of the test masses in inertial space
    y = np.hstack([np.zeros((2, 1)), np.cumsum(H * (velocity[:, :-1] + velocity[:, 1:]) / 2, axis=1)])
    x_sc = -RATIO * (y[0] + y[1])
    scale = np.abs(y).max()
    np.testing.assert_allclose(x[0], y[0] - x_sc, atol=1e-12 * scale)
    np.testing.assert_allclose(x[1], y[1] - x_sc, atol=1e-12 * scale)


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


def test_thrust_is_delayed_lagged_and_moves_the_spacecraft(bare):
    n, force, lag = 60, 1e-6, 0.1
    command = np.zeros(n)
    command[2] = force
    x_1, x_2 = advance(bare(), n, F_x_sc=command)
    t = H * np.arange(n + 1)

    def step_response(u):  # double integral of 1 - exp(-u / lag)
        u = np.maximum(u, 0)
        return u**2 / 2 - lag * u + lag**2 * (1 - np.exp(-u / lag))

    expected = -force / 422.7 * (step_response(t - 0.45) - step_response(t - 0.55))
    np.testing.assert_allclose(x_1, expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_array_equal(x_1, x_2)


def test_the_three_bodies_share_an_external_force(bare):
    x_1, x_2 = advance(bare(), 100, F_noise_x_sc=1e-6)
    np.testing.assert_allclose(x_1, -0.5 * 1e-6 / 422.7 * (H * np.arange(101)) ** 2, rtol=1e-12)
    np.testing.assert_array_equal(x_1, x_2)
