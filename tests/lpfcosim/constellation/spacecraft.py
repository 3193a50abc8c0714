"""Telemetry of three LISA spacecraft with the motion that a test wants."""

import numpy as np

from fit.telemetry import Writer

FS = 10.0  # Hz
CHANNELS = {
    **{f"jitter_{angle}": ("rad", "true attitude") for angle in ("theta", "eta", "phi")},
    **{f"jitter_x_{j}": ("m", "true position of a test mass") for j in (1, 2)},
    **{f"mosa_{j}": ("rad", "yaw of an assembly") for j in (1, 2)},
    **{f"dws_{angle}_{j}": ("rad", "wavefront sensing") for angle in ("phi", "eta") for j in (1, 2)},
}
HALF_OPENING = np.radians(30.0)


def write_run(path, duration, motion, kind="sysid", fs=FS):
    """Write telemetry; `motion` maps channels, and noise ``n_dws_phi_1`` ..., to functions of time [s]."""
    n = round(duration * fs)
    t = np.arange(n) / fs
    root = {
        "schema": "lpf-telemetry/1",
        "run": path.stem,
        "kind": kind,
        "fs": fs,
        "t0": "2035-01-01T00:00:00Z",
    }
    with Writer(path, n, CHANNELS, root) as writer:
        x = {name: motion[name](t) if name in motion else 0 * t for name in CHANNELS}
        for j, side in ((1, 1), (2, -1)):
            x[f"dws_phi_{j}"] = x["jitter_phi"] + x[f"mosa_{j}"]
            x[f"dws_eta_{j}"] = (
                np.cos(HALF_OPENING) * x["jitter_eta"] - side * np.sin(HALF_OPENING) * x["jitter_theta"]
            )
            for name in (f"dws_phi_{j}", f"dws_eta_{j}"):
                x[name] = x[name] + (motion[f"n_{name}"](t) if f"n_{name}" in motion else 0.0)
        writer.append(t, x)


def write_constellation(folder, duration, motions, **options):
    """Write telemetry of three spacecraft; returns the files."""
    files = [folder / f"sc{i}.h5" for i in (1, 2, 3)]
    for file, motion in zip(files, motions, strict=True):
        write_run(file, duration, motion, **options)
    return files


def tone(f, amplitude, phase=0.0):
    return lambda t: amplitude * np.sin(2 * np.pi * f * t + phase)


def manoeuvre():
    """Return the motions of 12 tones of 30 nrad: three angles of each spacecraft, and its assemblies."""
    motions = []
    for i in range(3):
        f = [37e-3 + 4e-3 * i + 1e-3 * k for k in range(4)]
        motions.append(
            {
                **{f"jitter_{a}": tone(f[k], 30e-9, i + k) for k, a in enumerate(("theta", "eta", "phi"))},
                "mosa_1": tone(f[3], 30e-9),
                "mosa_2": tone(f[3], -30e-9),
                "jitter_x_1": tone(20e-3, 5e-9),
                "jitter_x_2": tone(25e-3, 5e-9),
            }
        )
    return motions
