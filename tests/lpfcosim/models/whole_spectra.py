"""Frequency responses and spectra of the whole spacecraft's linear loop, from the matrices of one step."""

import numpy as np

from lpfcosim.models import whole_loops, whole_rigid

OMEGA = tuple(f"Omega_{k}" for k in whole_rigid.ANGLES)
CHANNELS = (*whole_loops.READ_OUTS, *whole_loops.COMMANDS, *whole_rigid.MOTION, *OMEGA)


def transfer(run, frequency):
    """From `whole_loops.INPUTS` to `CHANNELS` in the linear closed loop, shape (n, 56, 45)."""
    step = whole_loops.loop(run)
    z = np.exp(2j * np.pi * run.h * np.asarray(frequency, dtype=float))[:, np.newaxis, np.newaxis]
    n, w = step.B.shape
    C = np.vstack([step.C, step.C_u, np.eye(15, n), np.eye(3, n, whole_rigid.OMEGA.start)])
    direct = np.vstack([step.D, step.D_u, np.zeros((18, w))])
    into = step.B + step.B_u @ step.D_u
    return C @ np.linalg.solve(z * np.eye(n) - step.closed, into) + direct


def spectra(run, frequency, psd):
    """Stationary one-sided PSD of `CHANNELS` for that of independent inputs; what is missing is quiet."""
    H = transfer(run, frequency)
    S = [np.broadcast_to(np.asarray(psd.get(name, 0.0)), len(H)) for name in whole_loops.INPUTS]
    power = np.einsum("noi,ni->on", np.abs(H) ** 2, np.stack(S, axis=1))
    return dict(zip(CHANNELS, power, strict=True))
