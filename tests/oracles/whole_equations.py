"""Equations of the whole spacecraft as they stand, and its closed loop by a general integrator: an oracle."""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import bilinear, lfilter

from lpfcosim.spacecraft import ETA_PER_X, PHI_PER_X
from tests.oracles.lisa_equations import ROTATION_LAW, SOFT_LAW, SUSPENSION_LAW, X_LAW, H, Laws

M_TM, M_SC, I_TM, D, ARM = 1.928, 422.7, 6.80e-4, 0.376, 0.011
I_SC = np.array([202.5, 209.7, 191.7])
SKEW = {
    "delta_phi": -2e-3, "delta_eta": 1e-3,
    "b_1": 1.2e-2, "b_2": -0.9e-2, "b_3": 2.2e-2, "b_4": -1.8e-2, "b_5": 1e-3, "b_6": -2e-3,
    "lambda_N": 1.1, "leak_phi_1": 40.0, "kappa_phi": 3e5, "kappa_eta": -2e5,
    "omega2_y": -8e-3, "omega2_z": 5e-3, "omega2_theta": -1e-2, "omega2_eta_0": 7e-3, "omega2_phi_0": 3e-3,
}  # fmt: skip


PER_X = {"eta": ETA_PER_X, "phi": PHI_PER_X}


def turning(truth, axis, of_authority):
    """Return the stiffness about y or z, which follows the authority where it has a background."""
    background = truth.get(f"omega2_{axis}_0")
    return truth.get(f"omega2_{axis}", -1.5e-6) if background is None else background + of_authority


def equations(run):
    """Write down the equations of motion as they stand; rate of change of the 36 states."""
    a, t = run.authority, run.truth
    offset = D * np.array([1, t["delta_phi"], t["delta_eta"]])
    R = np.array([-offset, offset]) / 2
    given = [
        t[f"alpha_x_{j}"] * F_max + t[f"alpha_phi_{j}"] * N_max
        for j, F_max, N_max in ((1, a.F_max_1, a.N_max_1), (2, a.F_max_2, a.N_max_2))
    ]
    k_s = np.array([[t[f"omega2_{j}_0"] + given[j - 1], t["omega2_y"], t["omega2_z"]] for j in (1, 2)])
    k_r = np.array([
        [t["omega2_theta"], *(turning(t, axis, per_x * k) for axis, per_x in PER_X.items())] for k in given
    ])  # fmt: skip

    def rate(y, f_1, f_2, es, asked, g, gamma, noise):
        # s, v, tilt, w of both test masses; attitude, Omega; thrusts
        s, v, tilt, w = (y[6 * i : 6 * i + 6].reshape(2, 3) for i in range(4))
        Omega, push = y[27:30], y[30:36] + noise
        f = es[0] + [[f_1, 0, 0], [f_2 - t["b_5"] * s[:, 1].mean() - t["b_6"] * s[:, 2].mean(), 0, 0]]
        force, torque = M_TM * (g - k_s * s + f), I_TM * (gamma - k_r * tilt + es[1])
        r = R + s
        a_O = (push[:3] - force.sum(axis=0)) / M_SC
        dOmega = push[3:] - (torque + np.cross(r, force)).sum(axis=0) - np.cross(Omega, I_SC * Omega)
        dOmega /= I_SC
        apparent = np.cross(dOmega, r) + np.cross(Omega, np.cross(Omega, r)) + 2 * np.cross(Omega, v)
        dv = force / M_TM - a_O - apparent
        dw = torque / I_TM - dOmega - np.cross(Omega, w)
        parts = (v, dv, w, dw, Omega, dOmega, (asked - y[30:36]) / 0.1)
        return np.concatenate([part.ravel() for part in parts])

    return rate


def by_integration(run, driven):
    """Solve the equations of motion as they stand between all switches; controllers as transfer functions."""
    truth = run.truth
    laws_of_motion = equations(run)

    def lead(fu, fz, fp):
        wu, wz, wp = 2 * np.pi * np.array([fu, fz, fp])
        num, den = [1, wz], np.polymul([1 / wp, 1], np.polymul([1 / wp, 1], [1 / wp, 1]))
        gain = wu**2 / abs(np.polyval(num, 1j * wu) / np.polyval(den, 1j * wu))
        return bilinear(gain * np.array(num), den, fs=1 / H)

    laws, b_a = Laws(), lead(0.07e-3, 0.021e-3, 0.42e-3)
    memory = {}

    def attitude(key, error):
        value, memory[key] = lfilter(*b_a, [error], zi=memory.get(key, np.zeros(3)))
        return value[0]

    delays = {"f1": truth["C_1"] / truth["lambda_1"] - H / 2, "f2": truth["C_2"] / truth["lambda_2"] - H / 2}
    delays |= {"es": truth["tau_es"], "thrust": 0.25}
    before = {"f1": 0.0, "f2": -run.dc, "es": np.zeros((2, 2, 3)), "thrust": np.zeros(6)}
    issued = {name: [] for name in delays}
    out = []
    unit = 1e-9
    y = np.zeros(36)
    y[27:30] = np.array([truth[f"Omega_{k}_start"] for k in ("theta", "eta", "phi")]) / unit

    def held(name, t):
        i = int(np.floor((t - delays[name]) / H))
        return issued[name][i] if i >= 0 else before[name]

    for n in range(run.n_samples):
        s, tilt = y[0:6].reshape(2, 3) * unit, y[12:18].reshape(2, 3) * unit
        now = {name: values[n] for name, values in driven.items()}
        grs = {
            f"{k}_{j + 1}": s[j, i] + now[f"n_grs_{k}_{j + 1}"] for j in (0, 1) for i, k in enumerate("xyz")
        }
        grs |= {
            f"{k}_{j + 1}": tilt[j, i] + now[f"n_grs_{k}_{j + 1}"]
            for j in (0, 1)
            for i, k in enumerate(("theta", "eta", "phi"))
        }
        means = tilt[:, 2], tilt[:, 1], s[:, 1], s[:, 2]
        bump = sum(truth[f"b_{i}"] * mean.mean() for i, mean in enumerate(means, 1))
        o_1 = s[0, 0] + now["n_1"]
        o_12 = s[1, 0] - s[0, 0] + truth[f"delta_ifo_{run.alignment_epoch}"] * s[0, 0] - bump + now["n_12"]
        o = {f"{k}_1": tilt[0, i] + now[f"n_{k}_1"] for k, i in (("eta", 1), ("phi", 2))}
        o |= {f"{k}_12": tilt[1, i] - tilt[0, i] + now[f"n_{k}_12"] for k, i in (("eta", 1), ("phi", 2))}
        ast = [y[24 + i] * unit + now[f"n_ast_{k}"] for i, k in enumerate(("theta", "eta", "phi"))]
        e = [ast[i] - now[f"attitude_{k}"] for i, k in enumerate(("theta", "eta", "phi"))]

        thrust = np.array([
            M_SC * laws(X_LAW, "x", o_1 - now["guidance_o_1"]),
            M_SC * laws(ROTATION_LAW, "y", (grs["y_1"] + grs["y_2"]) / 2),
            M_SC * laws(ROTATION_LAW, "z", (grs["z_1"] + grs["z_2"]) / 2),
            I_SC[0] * laws(ROTATION_LAW, "theta", grs["theta_1"]),
            I_SC[1] * laws(ROTATION_LAW, "eta", (grs["z_1"] - grs["z_2"]) / D),
            I_SC[2] * laws(ROTATION_LAW, "phi", (grs["y_2"] - grs["y_1"]) / D),
        ])  # fmt: skip
        f_2 = (
            -run.dc / truth["lambda_2"]
            - laws(SOFT_LAW, "x12", o_12 - now["guidance_o_12"])
            + now["F_x_2"] / M_TM
        )
        L = [attitude(i, e[i]) for i in range(3)]
        F = np.array(
            [[0, M_TM * D / 2 * L[2], -M_TM * D / 2 * L[1]], [0, -M_TM * D / 2 * L[2], M_TM * D / 2 * L[1]]]
        )
        N = -I_TM * np.array([
            [L[0], laws(SUSPENSION_LAW, "e1", o["eta_1"]), laws(SUSPENSION_LAW, "p1", o["phi_1"])],
            [
                laws(SUSPENSION_LAW, "t2", grs["theta_2"]),
                laws(SUSPENSION_LAW, "e2", o["eta_1"] + o["eta_12"]),
                laws(SUSPENSION_LAW, "p2", o["phi_1"] + o["phi_12"]),
            ],
        ])  # fmt: skip
        a = run.authority
        F = np.clip(F, -50e-12, 50e-12)
        top = np.array([[10.4e-12, 10.4e-12, m] for m in (a.N_max_1, a.N_max_2)])
        N = np.clip(N, -top, top)
        f_2 = np.clip(f_2, -a.F_max_2 / M_TM, a.F_max_2 / M_TM)
        f_1 = np.clip(now["F_x_1"], -a.F_max_1, a.F_max_1) / M_TM + now["f_x_1_jitter"]
        f_1 += truth["leak_phi_1"] * N[0, 2] / M_TM
        crossed = (truth["kappa_phi"] * N[1, 2] + truth["kappa_eta"] * N[1, 1]) / M_TM
        voltage_noise = [
            now[f"e_x_{j}"] * (F_max + N_max / ARM) / M_TM + now[f"e_N_{j}"] * N[j - 1, 2] / (ARM * M_TM)
            for j, F_max, N_max in ((1, a.F_max_1, a.N_max_1), (2, a.F_max_2, a.N_max_2))
        ]
        issued["f1"].append(truth["lambda_1"] * f_1 * (1 + now["gain_1"]) + voltage_noise[0])
        issued["f2"].append(truth["lambda_2"] * f_2 * (1 + now["gain_2"]) + crossed + voltage_noise[1])
        gain = np.array([[truth["lambda_1"]], [truth["lambda_2"]]])
        issued["es"].append(np.array([gain * F / M_TM, truth["lambda_N"] * N / I_TM]))
        issued["thrust"].append(thrust)
        out.append({
            "o_1": o_1, "o_12": o_12, "f_x_1": f_1, "f_x_2": f_2,
            **{f"o_{k}": v for k, v in o.items()}, **{f"grs_{k}": v for k, v in grs.items()},
            **dict(zip(("ast_theta", "ast_eta", "ast_phi"), ast, strict=True)),
            **dict(zip(("F_x_sc", "F_y_sc", "F_z_sc", "N_x_sc", "N_y_sc", "N_z_sc"), thrust, strict=True)),
            **{f"F_{k}_{j + 1}": F[j, i] for j in (0, 1) for k, i in (("y", 1), ("z", 2))},
            **{f"N_{k}_{j + 1}": N[j, i] for j in (0, 1) for i, k in enumerate(("theta", "eta", "phi"))},
            **{f"Omega_{k}": y[27 + i] * unit for i, k in enumerate(("theta", "eta", "phi"))},
        })  # fmt: skip
        g = np.array([[now["g_1"], now["g_y_1"], now["g_z_1"]], [now["g_2"], now["g_y_2"], now["g_z_2"]]])
        gamma = np.array([[now[f"gamma_{k}_{j}"] for k in ("theta", "eta", "phi")] for j in (1, 2)])
        noise = np.array([now[f"{kind}_noise_{k}_sc"] for kind in "FN" for k in "xyz"])

        def rate(_, y, acting, stray=(g, gamma, noise)):
            return laws_of_motion(y * unit, *acting, *stray) / unit

        edges = {n * H, (n + 1) * H}
        for delay in delays.values():
            edges |= {t for i in range(n + 1) if n * H + 1e-9 < (t := i * H + delay) < (n + 1) * H - 1e-9}
        for left, right in pairwise(sorted(edges)):
            acting = [held(name, (left + right) / 2) for name in ("f1", "f2", "es", "thrust")]
            y = solve_ivp(rate, (left, right), y, "DOP853", args=(acting,), rtol=1e-12, atol=1e-9).y[:, -1]
    return {name: np.array([row[name] for row in out]) for name in out[0]}
