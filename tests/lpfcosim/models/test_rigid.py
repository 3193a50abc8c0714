"""The plant of the whole spacecraft against closed forms, conservation laws and a general integrator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lpfcosim.models import whole_loops, whole_rigid
from lpfcosim.spacecraft.run import Truth
from lpfcosim.spacecraft.spacecraft import Spacecraft
from tests.oracles.whole_equations import FREE, I_SC, I_TM, M_SC, M_TM, NO_STIFFNESS, SKEW, D, H, equations


@pytest.fixture(scope="module")
def craft(make_run):
    """Make a noise-free run of the whole spacecraft."""
    return lambda spacecraft=None, **fields: make_run(spacecraft=spacecraft or Spacecraft(), **fields)


def advance(run, n, start=(), **inputs):
    """Step the plant alone, no command given; the 30 of motion and rates at n + 1 samples."""
    plant, apparent = whole_rigid.plant(run), whole_rigid.Apparent(run)
    u = np.zeros((n, whole_rigid.N_INPUTS))
    for name, values in inputs.items():
        u[:, 18 + whole_loops.DISTURBANCES.index(name)] = values
    states = np.zeros((n + 1, len(plant.A)))
    states[0] = plant.start
    for i, value in start:
        states[0, i] += value
    before = None
    for i in range(n):
        now = np.array(apparent(states[i], plant.C @ states[i] + plant.D @ u[i]))
        u[i, whole_rigid.QUADRATIC] = now if before is None else 1.5 * now - 0.5 * before
        before = now
        states[i + 1] = plant.A @ states[i] + plant.B @ u[i]
    return states[:, :30]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_free_mass_moves_straight_in_inertial_space(craft, axis):
    n, rate = 2000, 1e-3
    Omega = rate * np.eye(3)[axis]
    skew = replace(FREE, Omega_DC=tuple(Omega), delta_phi=0.1, delta_eta=-0.2)
    push = np.array([1e-4, -3e-4, 2e-4])
    motion = advance(craft(skew, truth=NO_STIFFNESS), n, start=[(15 + i, push[i]) for i in range(3)])
    R = np.array([D, skew.delta_y, skew.delta_z]) / 2
    t = H * np.arange(n + 1)[:, np.newaxis]
    for R_j, velocity, s in ((-R, push, motion[:, 0:3]), (R, 0 * push, motion[:, 3:6])):
        straight = R_j + (velocity + np.cross(Omega, R_j)) * t
        c, sine = np.cos(rate * t), np.sin(rate * t)
        unit = np.eye(3)[axis]
        turned = (
            straight * c - np.cross(unit, straight) * sine + unit * (straight @ unit)[:, np.newaxis] * (1 - c)
        )
        np.testing.assert_allclose(R_j + s, turned, rtol=0, atol=1e-8)
    np.testing.assert_allclose(motion[:, 12 + axis], rate * t[:, 0], rtol=1e-9)


def angular_momentum(run, motion):
    """Of all three bodies about their barycentre, which rests; body axes, shape (n, 3)."""
    sc = run.spacecraft
    R = np.array([D, sc.delta_y, sc.delta_z]) / 2
    Omega = motion[:, 27:30]
    r = np.stack([motion[:, 0:3] - R, motion[:, 3:6] + R])
    u = motion[:, 15:27].reshape(-1, 4, 3).swapaxes(0, 1)[:2] + np.cross(Omega, r)
    v_O = -M_TM * u.sum(axis=0) / (M_SC + 2 * M_TM)
    spins = motion[:, 21:24] + motion[:, 24:27] + 2 * Omega
    parts = [I_SC * Omega, I_TM * spins, *(M_TM * np.cross(r, u + v_O))]
    return np.array(parts)


def test_internal_forces_leave_the_angular_momentum_alone(craft):
    """Spacecraft at rest, then tumbling, when the length of the vector is what stays."""
    rng, n = np.random.default_rng(5), 1000
    names = [name for name in whole_loops.DISTURBANCES if name[0] == "g"]
    stray = {name: 1e-14 * rng.standard_normal(n).cumsum() for name in names}
    skew = replace(SKEW, b=(0,) * 6)
    run = craft(skew)
    parts = angular_momentum(run, advance(run, n, **stray))
    assert np.abs(parts.sum(axis=0)).max() < 1e-10 * np.abs(parts).max()
    run = craft(replace(skew, Omega_DC=(2e-4, -3e-4, 4e-4)))
    length = np.linalg.norm(angular_momentum(run, advance(run, n, **stray)).sum(axis=0), axis=1)
    np.testing.assert_allclose(length, length[0], rtol=2e-9)


@pytest.mark.parametrize("stiffness", [4e-2, -4e-4])
@pytest.mark.parametrize("k", ["x", "y", "z", "theta", "eta", "phi"])
def test_each_degree_of_freedom_is_an_oscillator(craft, k, stiffness):
    """Sum and difference of the test masses, each with its own recoil of the spacecraft."""
    n, push = 1000, np.array([1e-12, -4e-12])
    field = {"y": "omega2_y", "z": "omega2_z", **{a: f"omega2_{a}" for a in ("theta", "eta", "phi")}}
    sc = replace(FREE, **({field[k]: stiffness} if k != "x" else {}))
    x = {"omega2_1_0": stiffness, "omega2_2_0": stiffness} if k == "x" else {}
    names = [f"g_{j}" if k == "x" else f"g_{k}_{j}" if k in "yz" else f"gamma_{k}_{j}" for j in (1, 2)]
    run = craft(sc, truth=replace(NO_STIFFNESS, **x))
    motion = advance(run, n, **dict(zip(names, push, strict=True)))
    i = [whole_rigid.MOTION.index(f"{k}_{j}") for j in (1, 2)]
    recoil = {"theta": 2 * I_TM / I_SC[0], "eta": 2 * I_TM / I_SC[1], "phi": 2 * I_TM / I_SC[2]}
    with_sum = 1 + recoil.get(k, 2 * M_TM / M_SC)
    lever = {"y": M_TM * D**2 / (2 * I_SC[2]), "z": M_TM * D**2 / (2 * I_SC[1])}
    with_difference = 1 + lever.get(k, 0.0)
    t = H * np.arange(n + 1)
    for got, gain, g in (
        (motion[:, i[0]] + motion[:, i[1]], with_sum, push.sum()),
        (motion[:, i[1]] - motion[:, i[0]], with_difference, push[1] - push[0]),
    ):
        root = np.sqrt(complex(stiffness * gain))
        expected = (2 * g / stiffness * np.sin(root * t / 2) ** 2).real
        np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("tau_es", [0.1, 0.04, 0.27])
def test_force_at_a_sample_is_the_one_acting_from_then_on(craft, tau_es):
    run = craft(replace(FREE, tau_es=tau_es), truth=NO_STIFFNESS)
    plant = whole_rigid.plant(run)
    state, pushed = plant.start, []
    for n in range(8):
        u = np.eye(whole_rigid.N_INPUTS)[1] * (n == 2)  # along y, for one sample
        pushed.append((plant.C @ state + plant.D @ u)[1])
        state = plant.A @ state + plant.B @ u
    t = H * np.arange(8) + 1e-9
    np.testing.assert_allclose(pushed, (t >= 0.2 + tau_es) & (t < 0.3 + tau_es), atol=1e-12)


def test_quadratic_terms_are_of_second_order(craft):
    """Every term large: test masses centimetres away and spinning; half the step, a quarter of the error."""
    rng, time = np.random.default_rng(11), 4.0
    size = np.repeat([1e-2, 1e-2, 1e-1, 3e-3, 2e-2, 2e-2], [6, 6, 3, 6, 6, 3])
    first = size * rng.uniform(0.5, 1, 30) * rng.choice([-1, 1], 30)
    order = np.r_[0:6, 15:21, 6:12, 21:27, 12:15, 27:30]  # where the equations below have these states
    stiff = Truth(omega2_1_0=-4e-3, omega2_2_0=2e-3)
    run = craft(replace(SKEW, delta_phi=0.2, delta_eta=-0.3, tau_es=0.2), truth=stiff)
    rate, quiet = equations(run), (0.0, 0.0, np.zeros((2, 2, 3)), np.zeros(6), 0.0, 0.0, 0.0)
    y = np.concatenate([first[order], np.zeros(6)])
    solution = solve_ivp(lambda _, y: rate(y, *quiet), (0, time), y, "DOP853", rtol=1e-13, atol=1e-16)

    def error(h):
        moved = advance(replace(run, h=h), round(time / h), start=enumerate(first))[-1]
        return np.abs(moved[order] - solution.y[:30, -1])

    coarse, fine = error(0.1), error(0.05)
    assert (coarse < 1e-4 * np.abs(solution.y[:30]).max(axis=1)).all()
    affected = coarse > 1e-9
    assert affected[:24].all()  # positions, angles and their rates
    np.testing.assert_allclose(coarse[affected] / fine[affected], 4, atol=0.5)
