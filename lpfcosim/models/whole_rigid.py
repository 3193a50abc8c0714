"""Spacecraft and two test masses, six degrees of freedom each, exactly discretised; knows no FMU.

In the body frame, whose origin is the centre of the spacecraft, test mass j sits at r_j = R_j + s_j with
R_2 = (d, delta_y, delta_z)/2 = -R_1; its forces F_j and torques N_j act back on the spacecraft::

    F_j / m_tm   = g_j - omega2_j s_j + f_j,  along x of j = 2 also -(b_5 ybar + b_6 zbar), eq. bump
    N_j / I_tm   = gamma_j - omega2_j angle_j + nu_j
    m_sc a_O     = F_thrust + F_noise - F_1 - F_2
    I_sc dOmega  = N_thrust + N_noise - sum_j (N_j + R_j x F_j) + t
    s_j''        = F_j / m_tm - a_O - dOmega x R_j + q_j
    angle_j''    = N_j / I_tm - dOmega + p_j
    thrust'      = (command(t - thruster_delay) - thrust) / thruster_lag         of forces and torques alike

All this is linear and each step of it exact: a delayed command switches inside the step. What is quadratic
(`apparent`) enters as t, q_j and p_j, held over the step.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.models.loop import held
from lpfcosim.spacecraft import Run, Spacecraft

Array = NDArray[np.float64]
Vector = Sequence[float]

AXES, ANGLES = ("x", "y", "z"), ("theta", "eta", "phi")
S = tuple(f"{k}_{j}" for j in (1, 2) for k in AXES)
TILT = tuple(f"{k}_{j}" for j in (1, 2) for k in ANGLES)
MOTION = (*S, *TILT, "Theta", "Eta", "Phi")

# continuous state: MOTION, then its rates v_j, w_j, Omega, then thrust (forces, torques)
_s, _tilt, _v, _w, _thrust = slice(0, 6), slice(6, 12), slice(15, 21), slice(21, 27), slice(30, 36)
OMEGA = slice(27, 30)
N_STATES = 36

# inputs: delayed commands f_j, nu_j and thrust; then noise and the quadratic terms, held over a step
_f, _nu, _asked = slice(0, 6), slice(6, 12), slice(12, 18)
_noise, _g, _gamma = slice(18, 24), slice(24, 30), slice(30, 36)
_q, _p, _t = slice(36, 42), slice(42, 48), slice(48, 51)
DELAYED, NOISE, QUADRATIC = slice(0, 18), slice(18, 36), slice(36, 51)
N_INPUTS = 51


@dataclass(frozen=True)
class Plant:
    """One exact step, ``state+ = A state + B u``; F_j/m_tm and dOmega at the sample are ``C state + D u``.

    The state begins with the 15 of `MOTION` and their rates [m, rad, s]; six thrusts [N, N m] and the
    commands already issued and still needed follow; ``start`` is its value at the equilibrium. The inputs are
    f_j [m s^-2], nu_j [rad s^-2] (j = 1, 2), thrust commands [N, N m]; noise on the spacecraft [N, N m], g_j
    [m s^-2], gamma_j [rad s^-2]; q_j [m s^-2], p_j [rad s^-2], t [N m].
    """

    A: Array
    B: Array
    C: Array
    D: Array
    start: Array


def equipment(run: Run) -> Spacecraft:
    """Give what ``run`` has beside the x axis."""
    if not isinstance(run.spacecraft, Spacecraft):
        raise TypeError(f"{run.name}: is not of the whole spacecraft")
    return run.spacecraft


def offsets(spacecraft: Spacecraft) -> tuple[Array, Array]:
    """Give R_1 and R_2, the places of the test masses [m]."""
    R = np.array([spacecraft.d, spacecraft.delta_y, spacecraft.delta_z]) / 2
    return -R, R


def inertia(spacecraft: Spacecraft) -> Array:
    """Give the diagonal of I_sc [kg m^2]."""
    return np.array([spacecraft.I_xx_sc, spacecraft.I_yy_sc, spacecraft.I_zz_sc])


def angular_stiffness(run: Run) -> Array:
    """Give the stiffness of test masses 1 and 2 about x, y, z [s^-2], shape (2, 3).

    What authority adds along x, by eq. stiff_model, it adds in proportion about y and z.
    """
    sc, truth = equipment(run), run.truth
    constant = np.array([sc.omega2_theta, sc.omega2_eta, sc.omega2_phi])
    along_x = np.array([run.omega2_1 - truth.omega2_1_0, run.omega2_2 - truth.omega2_2_0])
    return constant + np.outer(along_x, [0.0, sc.eta_per_x, sc.phi_per_x])


def plant(run: Run) -> Plant:
    """Discretise the three bodies, the thrusters and the delays exactly."""
    h = run.h
    continuous, rates = _continuous(run)
    transports = [equipment(run).tau_es] * 12 + [run.thruster_delay] * 6
    transports[0], transports[3] = max(run.tau_1 - h / 2, 0.0), max(run.tau_2 - h / 2, 0.0)
    values = np.zeros(18)  # commands issued before the run
    values[3], values[12] = run.truth.lambda_2 * run.f_x_2_start, run.F_x_sc_start

    splits = {transport: divmod(transport, h) for transport in transports}
    whole, *rest = held(continuous[:N_STATES], [h, *(h - switch for _, switch in splits.values())])
    late = dict(zip(splits, rest, strict=True))
    lengths = [int(splits[t][0]) + (splits[t][1] > 0) for t in transports]
    n = N_STATES + sum(lengths)
    A, B, start = np.zeros((n, n)), np.zeros((n, N_INPUTS)), np.zeros(n)
    C, D = np.zeros((9, n)), np.zeros((9, N_INPUTS))
    A[:N_STATES, :N_STATES], B[:N_STATES, 18:] = whole[:, :N_STATES], whole[:, N_STATES + 18 :]
    C[:, :N_STATES], D[:, 18:] = rates[:, :N_STATES], rates[:, N_STATES + 18 :]
    start[OMEGA] = equipment(run).Omega_DC
    start[_thrust.start] = run.F_x_sc_start
    first = N_STATES
    for i, (transport, length) in enumerate(zip(transports, lengths, strict=True)):
        after = late[transport][:, N_STATES + i]  # the newer value acts after the switch
        before = whole[:, N_STATES + i] - after
        # columns of the command by its age in samples: age 0 is the input, the others are remembered
        column = [B[:, i], *(A[:, first + age] for age in range(length))]
        rate = [D[:, i], *(C[:, first + age] for age in range(length))]
        age = int(splits[transport][0])
        column[age][:N_STATES] += after
        column[-1][:N_STATES] += before
        rate[-1] += rates[:, N_STATES + i]
        for older, newer in zip(range(first, first + length), column, strict=False):
            newer[older] = 1
        start[first : first + length] = values[i]
        first += length
    return Plant(A, B, C, D, start)


def _continuous(run: Run) -> tuple[Array, Array]:
    """Give d/dt of (state, inputs), and the rows of F_j/m_tm and dOmega."""
    sc = equipment(run)
    every = np.eye(N_STATES + N_INPUTS)
    state, u = every[:N_STATES], every[N_STATES:]
    R, I_sc = offsets(sc), inertia(sc)
    stiffness = np.array([run.omega2_1, sc.omega2_y, sc.omega2_z, run.omega2_2, sc.omega2_y, sc.omega2_z])
    f = u[_g] + u[_f] - stiffness[:, np.newaxis] * state[_s]  # F_j / m_tm
    f[3] -= sc.b[4] * (state[1] + state[4]) / 2 + sc.b[5] * (state[2] + state[5]) / 2  # eq. bump
    rotational = angular_stiffness(run).reshape(6, 1)
    nu = u[_gamma] + u[_nu] - rotational * state[_tilt]  # N_j / I_tm

    push = state[_thrust] + u[_noise]
    a_O = (push[:3] - run.m_tm * (f[:3] + f[3:])) / run.m_sc
    torque = push[3:] - sc.I_tm * (nu[:3] + nu[3:]) + u[_t]
    torque -= run.m_tm * (np.cross(R[0], f[:3], axisb=0, axisc=0) + np.cross(R[1], f[3:], axisb=0, axisc=0))
    dOmega = torque / I_sc[:, np.newaxis]

    rate = np.zeros_like(every)
    rate[:15] = state[15:30]
    for j in (0, 1):
        axes = slice(3 * j, 3 * j + 3)
        rate[_v][axes] = f[axes] - a_O + np.cross(R[j], dOmega, axisb=0, axisc=0) + u[_q][axes]
        rate[_w][axes] = nu[axes] - dOmega + u[_p][axes]
    rate[OMEGA] = dOmega
    rate[_thrust] = (u[_asked] - state[_thrust]) / run.thruster_lag
    return rate, np.vstack([f, dOmega])


def _cross(a: Vector, b: Vector) -> tuple[float, float, float]:
    a_x, a_y, a_z = a
    b_x, b_y, b_z = b
    return a_y * b_z - a_z * b_y, a_z * b_x - a_x * b_z, a_x * b_y - a_y * b_x


class Apparent:
    """The quadratic terms of the equations of motion, from the motion at one sample.

    Plain numbers, not arrays: for three components arrays cost several times as much.
    """

    def __init__(self, run: Run) -> None:
        sc = equipment(run)
        self._m_tm = run.m_tm
        self._I_sc: list[float] = inertia(sc).tolist()
        self._R: list[list[float]] = [R.tolist() for R in offsets(sc)]

    def __call__(self, state: Array, rates: Array) -> tuple[float, ...]:
        """Give q_1, q_2 [m s^-2], p_1, p_2 [rad s^-2] and t [N m].

        Parameters
        ----------
        state : ndarray, shape (>= 30,)
            `MOTION` and its rates.
        rates : ndarray, shape (9,)
            F_1/m_tm, F_2/m_tm and dOmega without t.
        """
        x: list[float] = state[:30].tolist()
        rate: list[float] = rates.tolist()
        m, (I_x, I_y, I_z) = self._m_tm, self._I_sc
        s_1, s_2, Omega = x[0:3], x[3:6], x[27:30]
        a, b = _cross(s_1, rate[0:3]), _cross(s_2, rate[3:6])
        spin = _cross(Omega, (I_x * Omega[0], I_y * Omega[1], I_z * Omega[2]))
        t = -m * (a[0] + b[0]) - spin[0], -m * (a[1] + b[1]) - spin[1], -m * (a[2] + b[2]) - spin[2]
        dOmega = rate[6] + t[0] / I_x, rate[7] + t[1] / I_y, rate[8] + t[2] / I_z
        R_1, R_2 = self._R
        return (
            *_relative(R_1, s_1, x[15:18], Omega, dOmega),
            *_relative(R_2, s_2, x[18:21], Omega, dOmega),
            *_cross(x[21:24], Omega),
            *_cross(x[24:27], Omega),
            *t,
        )


def _relative(R: Vector, s: Vector, v: Vector, Omega: Vector, dOmega: Vector) -> tuple[float, float, float]:
    """-dOmega x s - Omega x (Omega x (R + s) + 2 v)."""
    a, b, c = _cross(Omega, (R[0] + s[0], R[1] + s[1], R[2] + s[2]))
    euler = _cross(s, dOmega)
    other = _cross((a + 2 * v[0], b + 2 * v[1], c + 2 * v[2]), Omega)
    return euler[0] + other[0], euler[1] + other[1], euler[2] + other[2]
