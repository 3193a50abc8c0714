"""What a run is expected to record, without simulating it: its response to the injections, and its noise.

Both are those of the linear closed loop, with no command at its limit. Of what is quadratic in the motion of
the whole spacecraft there is what is linear about its steady turn: a rate that adds to it pulls along x.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lpfcosim.signals import Noise
from lpfcosim.spacecraft import Run
from lpfcosim.worlds import System, drive, on_circle, world_of

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

RATE = 1.0  # Hz, of the response; nothing of it lies above half of that
_INJECTED = ("guidance_o_1", "guidance_o_12", "f_x_1", "F_x_2")
BLOCK = 3600  # s, stretch of injections held in memory


def response(run: Run, noise: Noise | None = None) -> dict[str, Array]:
    """Give what the injections make of the channels, every second.

    Parameters
    ----------
    run : Run
        What is injected, and into what.
    noise : Noise, optional
        To be there too; none otherwise.

    Returns
    -------
    dict of str to ndarray, shape (n_samples / 10,)
        Departures from the equilibrium of `System.channels`, SI.
    """
    s = world_of(run).system(run)
    stride = round(run.fs / RATE)
    n = run.n_samples // stride
    if not run.injections and noise is None:
        return {name: np.zeros(n) for name in s.channels}
    driving = (*_INJECTED, *s.inputs) if noise else _INJECTED
    columns = [i for i, name in enumerate(s.inputs) if name in driving]
    # one second at a time: its ten samples of injections together
    ahead = [s.B[:, columns]]
    for _ in range(stride - 1):
        ahead.append(s.A @ ahead[-1])
    pushes = np.concatenate([push.T for push in reversed(ahead)])
    A = np.linalg.matrix_power(s.A, stride)
    found = np.empty((n, len(s.channels)))
    state = np.zeros(len(A))
    for begin in range(0, n, BLOCK):
        end = min(begin + BLOCK, n)
        injected = drive.injections(run, begin * stride, end * stride)
        injected["f_x_1"] = injected["F_x_1"] / run.m_tm
        if noise:
            drawn = noise.take((end - begin) * stride)
            drawn["g_2"] -= run.dc  # the equilibrium holds it
            injected["f_x_1"] += drawn["f_x_1_jitter"]
            injected |= drawn
        still = np.zeros((end - begin) * stride)
        w = np.stack([injected.get(s.inputs[i], still) for i in columns], axis=1)
        track = np.empty((end - begin + 1, len(A)))
        track[0] = state
        for now, following, push in zip(
            track[:-1], track[1:], w.reshape(end - begin, -1) @ pushes, strict=True
        ):
            np.dot(A, now, out=following)
            following += push
        state = track[-1]
        found[begin:end] = track[:-1] @ s.C.T + w[::stride] @ s.D[:, columns].T
    return dict(zip(s.channels, found.T.copy(), strict=True))


def cross_spectra(run: Run, channels: Sequence[str], frequency: Array) -> Complex:
    """Give the cross-spectral matrices of the noise of channels, ``<x_i^* x_j>``, one-sided.

    Parameters
    ----------
    run : Run
        Where loop and noise come from.
    channels : sequence of str
        C of `System.channels`.
    frequency : ndarray, shape (n,)
        Hz.

    Returns
    -------
    ndarray, shape (n, C, C)
        Products of the units per Hz.
    """
    s = world_of(run).system(run)
    rows = [s.channels.index(name) for name in channels]
    H = transfer(s, run.h, frequency)[:, rows]
    psd = drive_psd(run, frequency)
    S = np.stack([psd.get(name, np.zeros(frequency.size)) for name in s.inputs], axis=1)
    return np.asarray(np.einsum("nik,nk,njk->nij", H.conj(), S, H, optimize=True))


def transfer(s: System, h: float, frequency: Array) -> Complex:
    """Give the frequency responses of the channels to the inputs, shape (n, channels, inputs).

    Parameters
    ----------
    s : System
        Of the loop.
    h : float
        Its sample time [s].
    frequency : ndarray, shape (n,)
        Hz.
    """
    z = on_circle(frequency, h)
    return np.asarray(s.C @ np.linalg.solve(z * np.eye(len(s.A)) - s.A, s.B.astype(complex)) + s.D)


def drive_psd(run: Run, frequency: Array) -> dict[str, Array]:
    """Give the one-sided PSD of the noise that is drawn at inputs of the loop, each of shape (n,)."""
    found: dict[str, Array] = {}
    for source in world_of(run).sources(run):
        into = "f_x_1" if source.into == "f_x_1_jitter" else source.into
        found[into] = found.get(into, 0.0) + source.psd(frequency, run.h)
    return found
