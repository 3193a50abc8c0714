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
_ENTERS = {"F_x_1": "f_x_1"}  # where an injection enters the system, if not under its own name
STRETCH = 60  # s, stepped side by side
BLOCK = STRETCH**2  # s, held in memory


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
    driving = {_ENTERS.get(injection.into, injection.into) for injection in run.injections}
    if noise:
        driving = set(s.inputs)
    columns = {name: i for i, name in enumerate(s.inputs) if name in driving}
    found = np.zeros((n, len(s.channels)))
    # one second at a time: its ten samples of injections together
    ahead = [s.B]
    for _ in range(stride - 1):
        ahead.append(s.A @ ahead[-1])
    pushes = np.stack(ahead[::-1])
    loop = _Loop(np.linalg.matrix_power(s.A, stride), s.C)
    state = np.zeros(len(s.A))
    for begin in range(0, n if columns else 0, BLOCK):
        end = min(begin + BLOCK, n)
        injected = drive.injections(run, begin * stride, end * stride)
        injected["f_x_1"] = injected["F_x_1"] / run.m_tm
        if noise:
            drawn = noise.take((end - begin) * stride)
            drawn["g_2"] -= run.dc  # the equilibrium holds it
            injected["f_x_1"] += drawn["f_x_1_jitter"]
            injected |= drawn
        push = np.zeros((end - begin, len(s.A)))
        for name, i in columns.items():
            if name in injected:
                each = injected[name].reshape(-1, stride)
                push += each @ pushes[:, :, i]
                found[begin:end] += np.outer(each[:, 0], s.D[:, i])
        seen, state = loop.track(state, push)
        found[begin:end] += seen
    return dict(zip(s.channels, found.T.copy(), strict=True))


class _Loop:
    """Steps ``state+ = A state + push``, many stretches of a run side by side, and looks at ``C state``."""

    def __init__(self, A: Array, C: Array) -> None:
        self._A, self._C, self._over = A, C, np.linalg.matrix_power(A, STRETCH)
        later = [C]
        for _ in range(STRETCH - 1):
            later.append(later[-1] @ A)
        self._later = np.concatenate(later)

    def track(self, state: Array, push: Array) -> tuple[Array, Array]:
        """Return what is seen before each of n pushes, shape (n, S), and the state a whole BLOCK later."""
        n, size = push.shape
        rows = -(-n // STRETCH)
        pushes = np.zeros((rows, STRETCH, size))
        pushes.reshape(-1, size)[:n] = push
        resting = np.zeros((STRETCH + 1, rows, size))  # every stretch as if it began at rest
        for j in range(STRETCH):
            np.matmul(resting[j], self._A.T, out=resting[j + 1])
            resting[j + 1] += pushes[:, j]
        begun = np.empty((rows, size))
        for row, end in zip(begun, resting[-1], strict=True):
            row[:] = state
            state = self._over @ state + end
        seen = (resting[:-1] @ self._C.T).transpose(1, 0, 2) + (begun @ self._later.T).reshape(
            rows, STRETCH, -1
        )
        return seen.reshape(rows * STRETCH, -1)[:n], state


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
