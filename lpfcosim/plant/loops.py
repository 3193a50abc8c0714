"""The control of the whole spacecraft without FMUs: read-outs, loops, commands, and one step of all of it.

Fifteen loops (`LOOPS`) turn errors into commands: thrusters follow x_1 and y, z, theta of the test masses,
electrostatic forces and torques hold x_2 and the angles, and the star tracker turns the spacecraft through
differential forces on the test masses, which the thrusters then follow.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.plant import reference
from lpfcosim.plant.rigid import ANGLES, DELAYED, MOTION, NOISE, QUADRATIC, TILT, S, equipment, plant
from lpfcosim.spacecraft import Lead, Run

Array = NDArray[np.float64]

LOOPS = (
    *(f"drag_free_{k}" for k in ("x", "y", "z", *ANGLES)),
    *(f"suspension_{k}" for k in ("x", "eta_1", "phi_1", "theta_2", "eta_2", "phi_2")),
    *(f"attitude_{k}" for k in ANGLES),
)
THRUST = ("F_x_sc", "F_y_sc", "F_z_sc", "N_x_sc", "N_y_sc", "N_z_sc")
LATERAL = ("F_y_1", "F_z_1", "F_y_2", "F_z_2")
COMMANDS = ("f_x_2", *LATERAL, *(f"N_{k}" for k in TILT), *THRUST)
READ_OUTS = (
    *("o_1", "o_12", "o_phi_1", "o_phi_12", "o_eta_1", "o_eta_12"),
    *(f"grs_{k}" for k in (*S, *TILT)),
    *(f"ast_{k}" for k in ANGLES),
)
SET_POINTS = ("guidance_o_1", "guidance_o_12", *(f"attitude_{k}" for k in ANGLES))
NOISES = tuple(f"n_{name.removeprefix('o_')}" for name in READ_OUTS)
DISTURBANCES = (
    *(f"{kind}_noise_{k}_sc" for kind in ("F", "N") for k in ("x", "y", "z")),
    *("g_1", "g_y_1", "g_z_1", "g_2", "g_y_2", "g_z_2"),
    *(f"gamma_{k}" for k in TILT),
)
INPUTS = (*NOISES, *SET_POINTS, "f_x_1", *DISTURBANCES)


@dataclass(frozen=True)
class Loop:
    """One step of plant and controllers around the commands, which authority may clip.

    ``state+ = A state + B w + B_u u + B_q q`` with w = `INPUTS`, u = `COMMANDS` and the quadratic terms q of
    `rigid.Plant`; the controllers ask for ``u = C_u state + D_u w + u_start``. The read-outs are
    ``C_o state`` plus their noise; F_j/m_tm and dOmega are ``C_r state + D_r w + E_r u``.
    """

    A: Array
    B: Array
    B_u: Array
    B_q: Array
    C_u: Array
    D_u: Array
    u_start: Array
    C_o: Array
    C_r: Array
    D_r: Array
    E_r: Array
    start: Array

    @property
    def closed(self) -> Array:
        """State matrix of the linear closed loop, no command at its limit."""
        return self.A + self.B_u @ self.C_u


def read_outs(run: Run) -> Array:
    """Give the rows of `READ_OUTS` over `rigid.MOTION`, noise left out, shape (21, 15); eq. bump."""
    sc = equipment(run)
    m = dict(zip(MOTION, np.eye(15), strict=True))
    mean = {k: (m[f"{k}_1"] + m[f"{k}_2"]) / 2 for k in ("phi", "eta", "y", "z")}
    bump = sum(b * mean[k] for b, k in zip(sc.b, mean, strict=False))
    optical = {
        "o_1": m["x_1"],
        "o_12": m["x_2"] - m["x_1"] + run.delta_ifo * m["x_1"] - bump,
        **{f"o_{k}_1": m[f"{k}_1"] for k in ("phi", "eta")},
        **{f"o_{k}_12": m[f"{k}_2"] - m[f"{k}_1"] for k in ("phi", "eta")},
    }
    return np.vstack([*(optical[name] for name in READ_OUTS[:6]), np.eye(15)])


def errors(run: Run) -> tuple[Array, Array]:
    """Give the errors of `LOOPS` over `READ_OUTS`, shape (15, 21), and over `SET_POINTS`, shape (15, 5)."""
    d = equipment(run).d
    o = dict(zip(READ_OUTS, np.eye(len(READ_OUTS)), strict=True))
    rows = {
        "drag_free_x": o["o_1"],
        "drag_free_y": (o["grs_y_1"] + o["grs_y_2"]) / 2,
        "drag_free_z": (o["grs_z_1"] + o["grs_z_2"]) / 2,
        "drag_free_theta": o["grs_theta_1"],
        "drag_free_eta": (o["grs_z_1"] - o["grs_z_2"]) / d,
        "drag_free_phi": (o["grs_y_2"] - o["grs_y_1"]) / d,
        "suspension_x": o["o_12"],
        "suspension_theta_2": o["grs_theta_2"],
        **{f"suspension_{k}_1": o[f"o_{k}_1"] for k in ("phi", "eta")},
        **{f"suspension_{k}_2": o[f"o_{k}_1"] + o[f"o_{k}_12"] for k in ("phi", "eta")},
        **{f"attitude_{k}": o[f"ast_{k}"] for k in ANGLES},
    }
    followed = ("drag_free_x", "suspension_x", *(f"attitude_{k}" for k in ANGLES))
    set_points = -np.array([[name == other for other in followed] for name in LOOPS], dtype=float)
    return np.array([rows[name] for name in LOOPS]), set_points


def actuation(run: Run) -> Array:
    """Give the `COMMANDS` over the outputs of the controllers of `LOOPS`, shape (17, 15)."""
    sc = equipment(run)
    effort = {  # loop: {command: per m s^-2 or rad s^-2 that its controller asks for}
        "drag_free_x": {"F_x_sc": run.m_sc},
        "drag_free_y": {"F_y_sc": run.m_sc},
        "drag_free_z": {"F_z_sc": run.m_sc},
        "drag_free_theta": {"N_x_sc": sc.I_xx_sc},
        "drag_free_eta": {"N_y_sc": sc.I_yy_sc},
        "drag_free_phi": {"N_z_sc": sc.I_zz_sc},
        "suspension_x": {"f_x_2": -1.0},
        **{f"suspension_{k}": {f"N_{k}": -sc.I_tm} for k in TILT[1:]},
        "attitude_theta": {"N_theta_1": -sc.I_tm},
        "attitude_eta": {"F_z_1": -run.m_tm * sc.d / 2, "F_z_2": run.m_tm * sc.d / 2},
        "attitude_phi": {"F_y_1": run.m_tm * sc.d / 2, "F_y_2": -run.m_tm * sc.d / 2},
    }
    return np.array([[effort[loop].get(command, 0.0) for loop in LOOPS] for command in COMMANDS])


def limits(run: Run) -> Array:
    """Give the authority of each of `COMMANDS`, shape (17,); thrusters have no limit."""
    sc, a = equipment(run), run.authority
    angles = (sc.N_max_theta, sc.N_max_eta)
    forces = (a.F_max_2 / run.m_tm, *[sc.F_max_yz] * 4)
    return np.array([*forces, *angles, a.N_max_1, *angles, a.N_max_2, *[np.inf] * 6])


def applied(run: Run) -> tuple[Array, Array]:
    """Give what acts after its delay, inputs of `rigid.Plant`, over `COMMANDS` (18, 17) and f_x_1 (18,)."""
    sc, truth = equipment(run), run.truth
    c = dict(zip(COMMANDS, np.eye(len(COMMANDS)), strict=True))
    gain = {"1": truth.lambda_1 / run.m_tm, "2": truth.lambda_2 / run.m_tm}
    lateral = {name: gain[name[-1]] * c[name] for name in LATERAL}
    crossed = (sc.kappa_phi * c["N_phi_2"] + sc.kappa_eta * c["N_eta_2"]) / run.m_tm
    forces = [
        gain["1"] * sc.leak_phi_1 * c["N_phi_1"],
        *(lateral[name] for name in LATERAL[:2]),
        truth.lambda_2 * c["f_x_2"] + crossed,
        *(lateral[name] for name in LATERAL[2:]),
    ]
    torques = [sc.lambda_N / sc.I_tm * c[f"N_{k}"] for k in TILT]
    return np.array([*forces, *torques, *(c[k] for k in THRUST)]), truth.lambda_1 * np.eye(18)[0]


def controllers(run: Run) -> tuple[Array, Array, Array, Array]:
    """Discretise the controllers of `LOOPS` with the bilinear rule.

    Returns
    -------
    A, B, C, D : ndarray, shapes (45, 45), (45, 15), (15, 45), (15, 15)
        ``state+ = A state + B e``, ``output = C state + D e``.
    """
    sc = equipment(run)
    x = {"drag_free_x": run.drag_free, "suspension_x": run.suspension}
    others = {"drag": sc.rotation, "suspension": sc.angles}
    parts = []
    for name in LOOPS:
        if name.startswith("attitude"):
            parts.append(_lead(sc.attitude, run.h))
            continue
        settings = x.get(name) or others[name.split("_")[0]]
        decay, entry, direct = reference.controller(settings, run.h)
        parts.append((np.diag(decay), entry, np.ones(3), direct))
    A, B, C, D = zip(*parts, strict=True)
    columns, rows = ([b[:, np.newaxis] for b in B], [c[np.newaxis] for c in C])
    A_c, B_c, C_c = (scipy.linalg.block_diag(*blocks) for blocks in (A, columns, rows))
    return A_c, B_c, C_c, np.diag(D)


def _lead(settings: Lead, h: float) -> tuple[Array, Array, Array, float]:
    """Three lags in a row, k (p u_2 + (z - p) u_3)."""
    p, z = 2 * np.pi * settings.pole, 2 * np.pi * settings.zero
    decay, entry = (1 - h * p / 2) / (1 + h * p / 2), h * p / 2 / (1 + h * p / 2)
    # u_i = state_i + entry u_(i-1), u_0 = e: rows of u_1, u_2, u_3 over (states, e)
    u = np.array(
        [[entry ** (i - j) if j <= i else 0.0 for j in range(3)] + [entry ** (i + 1)] for i in range(3)]
    )
    into = np.vstack([[0, 0, 0, 1], u[:2]])
    following = decay * np.eye(3, 4) + (1 + decay) * entry * into
    out = settings.gain * (p * u[1] + (z - p) * u[2])
    return following[:, :3], following[:, 3], out[:3], float(out[3])


def loop(run: Run) -> Loop:
    """Close every loop up to the authority of its command."""
    body = plant(run)
    n, n_w, first = len(body.A), len(INPUTS), INPUTS.index("f_x_1")
    A_c, B_c, C_c, D_c = controllers(run)
    C_o = np.hstack([read_outs(run), np.zeros((len(READ_OUTS), n - 15 + len(A_c)))])
    over_read_outs, over_set_points = errors(run)
    E = over_read_outs @ C_o
    D_e = np.hstack([over_read_outs, over_set_points, np.zeros((len(LOOPS), n_w - first))])
    M = actuation(run)
    over_commands, over_f_x_1 = applied(run)

    A = scipy.linalg.block_diag(body.A, A_c)
    A[n:] += B_c @ E
    B, D_r = np.zeros((len(A), n_w)), np.zeros((9, n_w))
    B[n:] = B_c @ D_e
    for into, matrix in ((B[:n], body.B), (D_r, body.D)):
        into[:, first] = matrix[:, DELAYED] @ over_f_x_1
        into[:, first + 1 :] = matrix[:, NOISE]
    still = np.zeros((len(A_c), 1))  # what reaches the plant only
    C_u = M @ D_c @ E
    C_u[:, n:] += M @ C_c
    u_start = np.zeros(len(COMMANDS))
    u_start[COMMANDS.index("f_x_2")] = run.f_x_2_start
    u_start[COMMANDS.index("F_x_sc")] = run.F_x_sc_start
    return Loop(
        A=A,
        B=B,
        B_u=np.vstack([body.B[:, DELAYED] @ over_commands, still * np.ones(len(COMMANDS))]),
        B_q=np.vstack([body.B[:, QUADRATIC], still * np.ones(15)]),
        C_u=C_u,
        D_u=M @ D_c @ D_e,
        u_start=u_start,
        C_o=C_o,
        C_r=np.hstack([body.C, np.zeros((9, len(A_c)))]),
        D_r=D_r,
        E_r=body.D[:, DELAYED] @ over_commands,
        start=np.concatenate([body.start, np.zeros(len(A_c))]),
    )
