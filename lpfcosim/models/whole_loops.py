"""The control of the whole spacecraft without FMUs: read-outs, loops, commands, and one step of all of it.

Fifteen loops (`LOOPS`) turn errors into commands: thrusters follow x_1 and y, z, theta of the test masses,
electrostatic forces and torques hold x_2 and the angles, and the star tracker turns the spacecraft through
differential forces on the test masses, which the thrusters then follow.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lpfcosim.models import along_x_plant
from lpfcosim.models import loop as loops
from lpfcosim.models.loop import (
    System,
    block_diagonal,
    linear,
    on_circle,
    sampled,
    sampled_lead,
    with_none,
)
from lpfcosim.models.whole_rigid import (
    ANGLES,
    DELAYED,
    MOTION,
    NOISE,
    OMEGA,
    QUADRATIC,
    TILT,
    Apparent,
    S,
    equipment,
    plant,
)
from lpfcosim.models.world import Gain
from lpfcosim.spacecraft import Run

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
class Loop(loops.Loop):
    """One step of plant and controllers, with what is quadratic in the motion.

    B_q q adds to the state, q of `whole_rigid.Plant`; F_j/m_tm and dOmega are ``C_r state + D_r w + E_r u``.
    """

    B_q: Array
    C_r: Array
    D_r: Array
    E_r: Array


def read_outs(run: Run) -> Array:
    """Give the rows of `READ_OUTS` over `whole_rigid.MOTION`, noise left out, shape (21, 15); eq. bump."""
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


def limits(run: Run) -> dict[str, float]:
    """Largest command that authority allows, by telemetry channel; thrusters have no limit."""
    sc, authority = equipment(run), run.authority
    found = along_x_plant.limits(run)
    for j, N_max in ((1, authority.N_max_1), (2, authority.N_max_2)):
        found |= {f"F_y_{j}": sc.F_max_yz, f"F_z_{j}": sc.F_max_yz}
        found |= {f"N_theta_{j}": sc.N_max_theta, f"N_eta_{j}": sc.N_max_eta, f"N_phi_{j}": N_max}
    return found


def applied(run: Run) -> tuple[Array, Array]:
    """Give what acts after its delay, over `COMMANDS` (18, 17) and f_x_1 (18,); see `whole_rigid.Plant`."""
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
    n = len(LOOPS)
    A, B, C, D = np.zeros((3 * n, 3 * n)), np.zeros((3 * n, n)), np.zeros((n, 3 * n)), np.zeros((n, n))
    for i, name in enumerate(LOOPS):
        own = slice(3 * i, 3 * i + 3)
        if name.startswith("attitude"):
            A[own, own], B[own, i], C[i, own], D[i, i] = sampled_lead(sc.attitude, run.h)
            continue
        law = x.get(name) or others[name.split("_")[0]]
        decay, B[own, i], D[i, i] = sampled(law, run.h)
        A[own, own], C[i, own] = np.diag(decay), 1.0
    return A, B, C, D


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

    A = block_diagonal(body.A, A_c)
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
        inputs=INPUTS,
        commands=COMMANDS,
        read_outs=READ_OUTS,
        A=A,
        B=B,
        B_u=np.vstack([body.B[:, DELAYED] @ over_commands, still * np.ones(len(COMMANDS))]),
        C_u=C_u,
        D_u=M @ D_c @ D_e,
        u_start=u_start,
        C=C_o,
        D=np.eye(len(READ_OUTS), n_w),
        start=np.concatenate([body.start, np.zeros(len(A_c))]),
        B_q=np.vstack([body.B[:, QUADRATIC], still * np.ones(15)]),
        C_r=np.hstack([body.C, np.zeros((9, len(A_c)))]),
        D_r=D_r,
        E_r=body.D[:, DELAYED] @ over_commands,
    )


def system(run: Run) -> System:
    """Close every loop about the steady turn, where what is quadratic has a linear part too."""
    step = loop(run)
    leak = np.array([leak_of_f_x_1(run) * (name == "N_phi_1") for name in COMMANDS])
    closed = linear(step, run, leak)
    D_u = closed.D[len(READ_OUTS) : -1]
    by_motion, by_rates = turning(run)
    q = by_rates @ (step.C_r + step.E_r @ step.C_u)
    q[:, : by_motion.shape[1]] += by_motion
    D_q = by_rates @ (with_none(step.D_r) + step.E_r @ D_u)
    return replace(closed, A=closed.A + step.B_q @ q, B=closed.B + step.B_q @ D_q)


def leak_of_f_x_1(run: Run) -> float:
    """Give what the channel f_x_1 shows of the torque N_phi_1 [kg^-1 m^-1]."""
    return equipment(run).leak_phi_1 / run.m_tm


def turning(run: Run) -> tuple[Array, Array]:
    """Give the derivatives of `Apparent` in the steady turn by motion (15, 30) and rates (15, 9)."""
    apparent, steady = Apparent(run), np.zeros(39)
    steady[OMEGA] = equipment(run).Omega_DC
    step = 1e-6  # the differences of a quadratic are exact, whatever it is
    rows = []
    for change in step * np.eye(steady.size):
        above, below = (apparent(x[:30], x[30:]) for x in (steady + change, steady - change))
        rows.append(np.subtract(above, below) / (2 * step))
    J = np.array(rows).T
    return J[:, :30], J[:, 30:]


def open_loop(run: Run) -> Gain:
    """Give the loop gain of the sampled system, all loops cut at their errors.

    Returns
    -------
    callable
        From frequency [Hz], shape (n,), to L, shape (n, 15, 15), in error = -L error over `LOOPS`; one loop
        with the others open is on the diagonal.
    """
    body = plant(run)
    into = body.B[:, DELAYED] @ applied(run)[0] @ actuation(run)
    out = np.zeros((len(LOOPS), len(body.A)))
    out[:, :15] = errors(run)[0] @ read_outs(run)
    A, B, C, D = controllers(run)

    def gain(frequency: ArrayLike) -> NDArray[np.complex128]:
        z = on_circle(frequency, run.h)
        response = out @ np.linalg.solve(z * np.eye(len(body.A)) - body.A, into)
        control = C @ np.linalg.solve(z * np.eye(len(A)) - A, B) + D
        return np.asarray(-response @ control)

    return gain
