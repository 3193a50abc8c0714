"""Equations of one spacecraft of LISA as they stand, and its closed loop by a general integrator: an oracle.

Positions are those of the test masses from the centre of mass, in axes of the spacecraft; assemblies turn by
any angle. Parameters have the names of the Modelica models.
"""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import bilinear, lfilter

H = 0.1
AXES, ANGLES = ("x", "y", "z"), ("theta", "eta", "phi")
X_LAW = (0.08, 30e-3, 6e-3, 0.8, 2.0)
ROTATION_LAW = (30e-3, 9e-3, 1.8e-3, 0.24, 0.6)
SUSPENSION_LAW = (2e-3, 0.6e-3, 0.12e-3, 12e-3, 60e-3)
SOFT_LAW = (1e-3, 0.3e-3, 0.06e-3, 6e-3, 30e-3)
OPENING = 3e-3
Z = np.array([0.0, 0.0, 1.0])


def turn(angle):
    """Return the matrix of a turn about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def equations(p):
    """Return the rate of change of the 40 states; p has the parameters of the plant by name."""
    a = p["half_opening"] + p["opening"], -p["half_opening"]
    pivot, rho = (np.array([[p[f"{name}_{k}_{j}"] for k in AXES] for j in (1, 2)]) for name in ("p", "rho"))
    I_sc = np.array([p[f"I_{k}{k}_sc"] for k in AXES])
    along_x = [
        p[f"omega2_x_{j}_0"] + p[f"alpha_x_{j}"] * p[f"F_max_{j}"] + p[f"alpha_phi_{j}"] * p[f"N_max_{j}"]
        for j in (1, 2)
    ]
    K = [np.diag([along_x[j - 1], p[f"omega2_y_{j}"], p["omega2_z"]]) for j in (1, 2)]
    gravity = np.array([[p[f"gravity_{k}_{j}"] for k in AXES] for j in (1, 2)])
    sunlight = np.array([p[f"F_solar_{k}"] for k in AXES])
    for j in (0, 1):
        K[j][0, 1] = K[j][1, 0] = p[f"omega2_xy_{j + 1}"]
    K_rot = np.array([p[f"omega2_{k}"] for k in ANGLES])
    w_m = 2 * np.pi * p["f_mosa"]

    def rate(y, f, nu, thrust, yaw_command, g, gamma, noise):
        s, v, tilt, w = (y[6 * i : 6 * i + 6].reshape(2, 3) for i in range(4))
        Omega, yaw, dyaw, push = y[27:30], y[30:32], y[32:34], y[34:40] + noise
        ddyaw = w_m**2 * (yaw_command - yaw) - 2 * p["damping_mosa"] * w_m * dyaw
        force, torque, R, M, g = [], [], [], [], g + gravity
        for j in (0, 1):
            M.append(turn(a[j] + yaw[j]))
            R.append(pivot[j] + M[j] @ (rho[j] + s[j]))
            force.append(M[j] @ (p["m_tm"] * (g[j] - K[j] @ s[j]) + f[j]))
            torque.append(M[j] @ (p["I_tm"] * (gamma[j] - K_rot * tilt[j]) + nu[j]))
        a_O = (push[:3] + sunlight - force[0] - force[1]) / p["m_sc"]
        N = push[3:] - torque[0] - torque[1] - np.cross(R, force).sum(axis=0)
        dOmega = (N - p["I_mosa"] * ddyaw.sum() * Z - np.cross(Omega, I_sc * Omega)) / I_sc
        dv, dw = np.zeros((2, 3)), np.zeros((2, 3))
        for j in (0, 1):
            arm = rho[j] + s[j]
            velocity = M[j] @ (v[j] + dyaw[j] * np.cross(Z, arm))  # seen from the spacecraft
            frame = a_O + np.cross(dOmega, R[j]) + np.cross(Omega, np.cross(Omega, R[j]))
            seen = M[j].T @ (force[j] / p["m_tm"] - frame - 2 * np.cross(Omega, velocity))
            turning = ddyaw[j] * np.cross(Z, arm) + 2 * dyaw[j] * np.cross(Z, v[j])
            dv[j] = seen - turning - dyaw[j] ** 2 * np.cross(Z, np.cross(Z, arm))
            spin = M[j].T @ Omega
            dspin = M[j].T @ dOmega + ddyaw[j] * Z - dyaw[j] * np.cross(Z, spin)
            dw[j] = M[j].T @ torque[j] / p["I_tm"] - dspin - np.cross(spin + dyaw[j] * Z, w[j])
        lag = (thrust - y[34:40]) / p["T_sc"]
        return np.concatenate([part.ravel() for part in (v, dv, w, dw, Omega, dOmega, dyaw, ddyaw, lag)])

    return rate


class Laws:
    """Transfer functions of the controllers, sampled by the bilinear rule."""

    def __init__(self):
        self._memory = {}

    def __call__(self, law, key, error):
        """Return what the law demands after one more sample of its error."""
        u, z, i, q, r = 2 * np.pi * np.array(law)
        numerator = np.polymul([1, z], [1, i])
        denominator = np.polymul([1, 0], np.polymul([1 / q, 1], [1 / r, 1]))
        gain = u**2 / abs(np.polyval(numerator, 1j * u) / np.polyval(denominator, 1j * u))
        b, a = bilinear(gain * numerator, denominator, fs=1 / H)
        value, self._memory[key] = lfilter(b, a, [error], zi=self._memory.get(key, np.zeros(3)))
        return value[0]

    def integral(self, unity_gain, key, error):
        """Return the integral of an error, with a gain of one at a frequency."""
        b, a = bilinear([2 * np.pi * unity_gain], [1, 0], fs=1 / H)
        value, self._memory[key] = lfilter(b, a, [error], zi=self._memory.get(key, np.zeros(1)))
        return value[0]


def read_out(y, p, now):
    """Return the channels that sensors give for the states of a sample."""
    s, tilt, yaw = y[0:6].reshape(2, 3), y[12:18].reshape(2, 3), y[30:32]
    o = {}
    for j, a in ((1, p["half_opening"]), (2, -p["half_opening"])):
        position, angle = s[j - 1], tilt[j - 1]
        leak = sum(p[f"o_per_{k}_{j}"] * position[i] for i, k in ((1, "y"), (2, "z")))
        leak += sum(p[f"o_per_{k}_{j}"] * angle[i] for i, k in ((1, "eta"), (2, "phi")))
        o[f"o_{j}"] = position[0] + leak + now[f"n_{j}"]
        o |= {f"o_{k}_{j}": angle[i] + now[f"n_{k}_{j}"] for i, k in ((1, "eta"), (2, "phi"))}
        eta, phi = np.cos(a) * y[25] - np.sin(a) * y[24], y[26] + yaw[j - 1]
        o[f"dws_eta_{j}"] = p["dws_gain"] * eta + now[f"n_dws_eta_{j}"]
        o[f"dws_phi_{j}"] = p["dws_gain"] * phi + now[f"n_dws_phi_{j}"]
        seen = position * [1, p[f"grs_gain_y_{j}"], 1] + [0, p[f"grs_y_per_x_{j}"] * position[0], 0]
        o |= {f"grs_{k}_{j}": seen[i] + now[f"n_grs_{k}_{j}"] for i, k in enumerate(AXES)}
        o |= {f"grs_{k}_{j}": angle[i] + now[f"n_grs_{k}_{j}"] for i, k in enumerate(ANGLES)}
        o |= {f"mosa_{j}": yaw[j - 1], f"jitter_x_{j}": position[0]}
    return o | {f"jitter_{k}": y[24 + i] for i, k in enumerate(ANGLES)}


def command(laws, p, o, now):
    """Return thrust [N, N m], yaws [rad], and forces [N] and torques [N m] on the test masses."""
    c, s = np.cos(p["half_opening"]), np.sin(p["half_opening"])
    e = {k: o[k] - now[f"guidance_{k}"] for k in ("o_1", "o_2")}
    e |= {f"y_{j}": o[f"grs_y_{j}"] - now[f"guidance_y_{j}"] for j in (1, 2)}
    along_1, z = laws(X_LAW, "x_1", e["o_1"]), laws(ROTATION_LAW, "z", (o["grs_z_1"] + o["grs_z_2"]) / 2)
    F = np.zeros((2, 3))
    if p["fall_back"]:
        across = laws(ROTATION_LAW, "y_1", e["y_1"])
        x, y = c * along_1 - s * across, s * along_1 + c * across
        F[1, 0] = -p["m_tm"] * laws(SOFT_LAW, "x_2", e["o_2"])
    else:
        along_2 = laws(X_LAW, "x_2", e["o_2"])
        x, y = np.linalg.solve([[c, s], [c, -s]], [along_1, along_2])
        F[0, 1] = -p["m_tm"] * laws(SUSPENSION_LAW, "y_1", e["y_1"])
    F[1, 1] = -p["m_tm"] * laws(SUSPENSION_LAW, "y_2", e["y_2"])
    F[1, 2] = -p["m_tm"] * laws(SUSPENSION_LAW, "dz", (o["grs_z_2"] - o["grs_z_1"]) / 2 - now["guidance_z"])
    F[0, 2] = -F[1, 2]
    N = np.array([
        [-p["I_tm"] * laws(SUSPENSION_LAW, f"{k}_{j}", o[f"{sensor}_{k}_{j}"] - now[f"guidance_{k}_{j}"])
         for k, sensor in zip(ANGLES, ("grs", "o", "o"), strict=True)]
        for j in (1, 2)
    ])  # fmt: skip
    attitude = {
        "theta": (o["dws_eta_2"] - o["dws_eta_1"]) / (2 * s),
        "eta": (o["dws_eta_1"] + o["dws_eta_2"]) / (2 * c),
        "phi": (o["dws_phi_1"] + o["dws_phi_2"]) / 2,
    }
    turns = [laws(ROTATION_LAW, k, attitude[k] - now[f"guidance_{k}"]) for k in ANGLES]
    thrust = p["m_sc"] * np.array([x, y, z])
    torque = [-p[f"I_{k}{k}_sc"] * turn for k, turn in zip(AXES, turns, strict=True)]
    wanted = now["guidance_opening"]
    error = o["dws_phi_1"] - o["dws_phi_2"] - wanted
    yaw = (wanted - laws.integral(OPENING, "opening", error)) / 2
    limits = np.array([[0.0, p["F_max_yz"], p["F_max_yz"]], [p["F_max_2"], p["F_max_yz"], p["F_max_yz"]]])
    largest = np.array([[p["N_max_theta"], p["N_max_eta"], p[f"N_max_{j}"]] for j in (1, 2)])
    F, N = np.clip(F, -limits, limits), np.clip(N, -largest, largest)
    return np.array([*thrust, *torque]), np.array([yaw, -yaw]), F, N


def applied(p, F, N, now):
    """Return the forces [N] and torques [N m] that the test masses receive after their delays."""
    gain = np.array([[p.get(f"lambda_{k}_{j}", 0.0) for k in AXES] for j in (1, 2)])
    received = gain * F
    for j in (0, 1):
        received[j, 0] += p[f"x_per_y_{j + 1}"] * F[j, 1] + p[f"x_per_phi_{j + 1}"] * N[j, 2]
        pull = p[f"F_max_{j + 1}"] + p[f"N_max_{j + 1}"] / p["arm"]
        received[j, :2] += now[f"e_x_{j + 1}"] * pull, now[f"e_y_{j + 1}"] * p["F_max_yz"]
    return received, p["lambda_N"] * N


class Motion:
    """The plant from sample to sample, solved between all switches of its inputs; at rest at first."""

    def __init__(self, p):
        self.states = np.zeros(40)
        self._rate, self._unit, self._n = equations(p), 1e-9, 0
        self._delays = {"mass_1": p["tau_1"], "mass_2": p["tau_2"], "thrust": p["tau_sc"]}
        self._issued = {"mass_1": [], "mass_2": [], "thrust": []}

    def advance(self, F, N, thrust, yaws, now):
        """Move on by a sample with forces, torques, thrust and yaws issued now, and stray ones by name."""
        for name, command in (("mass_1", [F[0], N[0]]), ("mass_2", [F[1], N[1]]), ("thrust", thrust)):
            self._issued[name].append(np.array(command))
        g = np.array([[now[f"g_{j}"], now[f"g_y_{j}"], now[f"g_z_{j}"]] for j in (1, 2)])
        gamma = np.array([[now[f"gamma_{i}_{j}"] for i in ANGLES] for j in (1, 2)])
        noise = np.array([now[f"{kind}_noise_{i}_sc"] for kind in "FN" for i in AXES])
        yaws = np.array([yaws[0] + now["n_mosa_1"], yaws[1] + now["n_mosa_2"]])
        start, end = self._n * H, (self._n + 1) * H
        switches = {i * H + delay for delay in self._delays.values() for i in range(self._n + 1)}
        edges = [start, *sorted(t for t in switches if start + 1e-9 < t < end - 1e-9), end]
        y = self.states / self._unit
        for begin, stop in pairwise(edges):
            time = (begin + stop) / 2
            masses = np.array([self._held(name, time) for name in ("mass_1", "mass_2")])
            acting = masses[:, 0], masses[:, 1], self._held("thrust", time), yaws, g, gamma, noise

            def rate(_, y, acting=acting):
                return self._rate(y * self._unit, *acting) / self._unit

            y = solve_ivp(rate, (begin, stop), y, "DOP853", rtol=1e-12, atol=1e-9).y[:, -1]
        self.states, self._n = y * self._unit, self._n + 1

    def _held(self, name, t):
        i = int(np.floor((t - self._delays[name]) / H))
        return self._issued[name][i] if i >= 0 else np.zeros_like(self._issued[name][0])


def by_integration(p, driven, n):
    """Return n samples of the closed loop; parameters and signals by name."""
    motion, laws, rows = Motion(p), Laws(), []
    for k in range(n):
        now = {name: values[k] for name, values in driven.items()}
        o = read_out(motion.states, p, now)
        thrust, yaws, F, N = command(laws, p, o, now)
        motion.advance(*applied(p, F, N, now), thrust, yaws, now)
        row = dict(zip([f"{kind}_{i}_sc" for kind in "FN" for i in AXES], thrust, strict=True))
        row |= {f"F_{i}_{j}": F[j - 1, m] for j in (1, 2) for m, i in enumerate(AXES) if (i, j) != ("x", 1)}
        row |= {f"N_{i}_{j}": N[j - 1, m] for j in (1, 2) for m, i in enumerate(ANGLES)}
        rows.append(o | row)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}
