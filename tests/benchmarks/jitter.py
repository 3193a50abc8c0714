"""What the motion of the spacecraft adds to Delta g, by frequency: ``python -m tests.benchmarks.jitter``.

From the linear closed loop, without a step, for the last noise run of a campaign; and, to check
these, the read-out o_12 of half a day simulated without FMUs.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import welch

from lpfcosim.campaign import loading
from lpfcosim.linear import ClosedLoop, margins, response
from tests import ROOT

F = np.array([0.1, 0.3, 0.5, 1, 2, 5, 10, 20, 30, 50, 70]) * 1e-3  # Hz
READ_OUTS = {
    "phi": {"o_phi_1": 1.0, "o_phi_12": 0.5},
    "eta": {"o_eta_1": 1.0, "o_eta_12": 0.5},
    "y": {"grs_y_1": 0.5, "grs_y_2": 0.5},
    "z": {"grs_z_1": 0.5, "grs_z_2": 0.5},
}


def delta_g_x(run, f):
    """Weights of the channels in Delta g_x, eq. deltagjointfit."""
    w, truth = 2 * np.pi * f, run.truth
    return {
        "o_12": run.omega2_2 - w**2 + 0j,
        "o_1": run.omega2_2 - run.omega2_1 + run.delta_ifo * w**2 + 0j,
        "f_x_2": -truth.lambda_2 * np.exp(-1j * w * run.tau_2),
        "f_x_1": truth.lambda_1 * np.exp(-1j * w * run.tau_1),
    }


def rotation(run, f, axis):
    """Weights of the channels in dOmega: N/I - omega2 o - o''."""
    sc, w = run.spacecraft, 2 * np.pi * f
    angle = w**2 - getattr(sc, f"omega2_{axis}") + 0j
    torques = {f"N_{axis}_{j}": 0.5 / sc.I_tm + 0 * angle for j in (1, 2)}
    return torques | {name: part * angle for name, part in READ_OUTS[axis].items()}


def asd(run, f, weights):
    """ASD of a sum of channels."""
    S = response.cross_spectra(run, tuple(weights), f)
    c = np.stack(list(weights.values()), axis=1)
    return np.sqrt(np.einsum("ni,nij,nj->n", c.conj(), S.transpose(0, 2, 1), c).real)


def jitter(run, f):
    """Cross-spectra of o_1, phi, eta, y and z, shape (n, 5, 5)."""
    names = ["o_1", *(name for parts in READ_OUTS.values() for name in parts)]
    mean = np.zeros((5, len(names)))
    mean[0, 0] = 1
    for row, parts in enumerate(READ_OUTS.values(), 1):
        for name, part in parts.items():
            mean[row, names.index(name)] = part
    return mean @ response.cross_spectra(run, names, f) @ mean.T


def without_motion(run):
    """Return a run to which motion adds nothing."""
    none = {"delta_phi": 0.0, "delta_eta": 0.0, "b": (0.0,) * 6, "Omega_DC": (0.0, 0.0, 0.0)}
    return replace(run, spacecraft=replace(run.spacecraft, **none))


def correlation(run):
    """Of delta_ifo with b_1 to b_4 in a fit of noise alone, and how that widens the sigma of delta_ifo."""
    f = np.geomspace(3e-3, 0.12, 100)
    still = without_motion(run)
    weight = (2 * np.pi * f) ** 4 / asd(still, f, delta_g_x(still, f)) ** 2
    information = np.trapezoid(weight[:, None, None] * jitter(run, f).real, f, axis=0)
    covariance = np.linalg.inv(information)
    sigma = np.sqrt(np.diag(covariance))
    return covariance[0, 1:] / sigma[0] / sigma[1:], sigma[0] * np.sqrt(information[0, 0])


def coherence(run, f):
    """Share of the power of o_1 that phi, eta, y and z tell, each frequency by itself."""
    S = jitter(run, f)
    told = np.linalg.solve(S[:, 1:, 1:], S[:, 1:, :1])
    return ((S[:, :1, 1:] @ told)[:, 0, 0] / S[:, 0, 0]).real


def stepped(run):
    """ASD of o_12 over its expectation, 10 to 100 mHz, of half a day without FMUs."""
    run = replace(run, n_samples=432_000)
    f, S = welch(ClosedLoop(run).simulate()["o_12"], fs=10, nperseg=20_000)
    band = (f > 10e-3) & (f < 100e-3)
    expected = response.cross_spectra(run, ("o_12",), f[band])[:, 0, 0].real
    return float(np.sqrt(np.mean(S[band] / expected)))


def main(path):
    """Print the table of a campaign."""
    run = [run for run in loading.load(path).runs if run.kind == "noise"][-1]
    sc = run.spacecraft
    still = without_motion(run)
    whole, alone = (asd(r, F, delta_g_x(r, F)) for r in (run, still))
    arms = {"phi": sc.delta_y, "eta": sc.delta_z}
    euler = np.hypot(*(arm * asd(run, F, rotation(run, F, axis)) for axis, arm in arms.items()))
    rows = {
        "mHz": F * 1e3,
        "Delta g_x": whole * 1e15,
        "without motion": alone * 1e15,
        "added by motion": np.sqrt(np.maximum(whole**2 - alone**2, 0)) * 1e15,
        "d delta dOmega": euler * 1e15,
        "told of o_1": coherence(run, F),
    }
    print(run.name, "fm s^-2 Hz^-1/2")
    for name, values in rows.items():
        print(f"{name:16}", *(f"{value:7.3g}" for value in values))
    for margin in margins.margins(run):
        print(f"{margin.loop:20}{margin.unity_gain * 1e3:9.4f} mHz{margin.phase_margin:6.1f} deg", end="")
        print(f"{margin.gain_margin:6.1f} dB")
    slow = replace(run, drag_free=sc.rotation)
    quiet = replace(slow, noise=replace(run.noise, grs=run.noise.grs / 10))
    changes = {"as it is": run, "x as slow as rotation": slow, "and inertial sensors / 10": quiet}
    for name, changed in changes.items():
        of_b, growth = correlation(changed)
        print(f"{name:26}delta_ifo with b_1 to b_4:", np.round(of_b, 2), f"sigma x {growth:.2f}")
    print(f"stepped over expected, o_12 at 10 to 100 mHz: {stepped(run):.3f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "campaigns" / "mission.toml")
