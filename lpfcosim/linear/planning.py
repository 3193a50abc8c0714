"""What a run is expected to record, without simulating it: its response to the injections, and its noise.

Both are those of the linear closed loop, with no command at its limit. Of what is quadratic in the motion of
the whole spacecraft there is what is linear about its steady turn: a rate that adds to it pulls along x.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lpfcosim.models import System, electrodes, on_circle, world_of
from lpfcosim.signals import Noise, Weights, commanded
from lpfcosim.spacecraft import Actuation, Injection, Run

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

RATE = 1.0  # Hz, of the response; nothing of it lies above half of that
_ENTERS = {"F_x_1": "f_x_1", "f_x_1_jitter": "f_x_1"}  # where what drives enters, if not under its own name
STRETCH = 30  # samples of what is returned, stepped side by side
BLOCK = 120 * STRETCH  # samples, held in memory: stretches that are whole
KEPT = 128  # blocks of commands, at 10 Hz of 0.3 MB for each signal; runs of a campaign share most of them


def response(run: Run, noise: Noise | None = None, rate: float = RATE) -> dict[str, Array]:
    """Give what the injections make of the channels.

    Parameters
    ----------
    run : Run
        What is injected, and into what.
    noise : Noise, optional
        To be there too; none otherwise.
    rate : float
        Of what is returned [Hz], which the sample rate of the run is a multiple of.

    Returns
    -------
    dict of str to ndarray, shape (n_samples rate / fs,)
        Departures from the equilibrium of `System.channels`, SI.
    """
    s = world_of(run).system(run)
    stride = round(run.fs / rate)
    n = run.n_samples // stride
    driving = {_ENTERS.get(injection.into, injection.into) for injection in run.injections}
    if noise:
        driving |= set(s.inputs) - set(world_of(run).turns(run))  # the equilibrium turns
    columns = {name: i for i, name in enumerate(s.inputs) if name in driving}
    if not columns:
        return {name: np.zeros(n) for name in s.channels}
    found = np.empty((len(s.channels), n))
    # the samples of injections from one to the next together
    ahead = [s.B]
    for _ in range(stride - 1):
        ahead.append(s.A @ ahead[-1])
    pushes = np.stack(ahead[::-1], axis=1)
    loop = _Loop(np.linalg.matrix_power(s.A, stride), s.C)
    state = np.zeros(len(s.A))
    for begin in range(0, n, BLOCK):
        end = min(begin + BLOCK, n)
        injected = dict(_commanded(run.injections, run.fs, begin * stride, end * stride))
        if "F_x_1" in injected:
            injected["f_x_1"] = injected["F_x_1"] / run.m_tm
        if noise:
            drawn = noise.take((end - begin) * stride)
            drawn["g_2"] -= run.dc  # the equilibrium holds it
            injected["f_x_1"] = injected.get("f_x_1", 0.0) + drawn["f_x_1_jitter"]
            injected = {name: x for name, x in (injected | drawn).items() if x.any()}
        felt = {i: injected[name] for name, i in columns.items() if name in injected}
        seen, state = loop.track(state, end - begin, ((pushes[:, :, i], x) for i, x in felt.items()))
        found[:, begin:end] = seen
        for i, x in felt.items():
            for k in np.flatnonzero(s.D[:, i]):
                found[k, begin:end] += x[::stride] * s.D[k, i]
    return dict(zip(s.channels, found, strict=True))


@lru_cache(maxsize=KEPT)
def _commanded(injections: tuple[Injection, ...], fs: float, start: int, stop: int) -> dict[str, Array]:
    """Return `signals.commanded`, those that are not zero: most is over, or is yet to come.

    Runs of other truths ask for the same ones.
    """
    found = {name: x for name, x in commanded(injections, fs, start, stop).items() if x.any()}
    for x in found.values():
        x.setflags(write=False)
    return found


class _Loop:
    """Steps ``state+ = A state + push``, many stretches of a run side by side, and looks at ``C state``."""

    def __init__(self, A: Array, C: Array) -> None:
        self._A, self._C = A, C
        later = [C]
        for _ in range(STRETCH - 1):
            later.append(later[-1] @ A)
        self._later = np.concatenate(later)
        self._over = [np.linalg.matrix_power(A, STRETCH)]  # then that of two stretches, of four ...
        while 2 ** len(self._over) <= BLOCK // STRETCH:
            self._over.append(self._over[-1] @ self._over[-1])

    def track(self, state: Array, n: int, pushes: Iterable[tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return what is seen before each of n pushes, shape (S, n), and the state a whole BLOCK later.

        A push is the sum of what every signal makes of m samples, the product of its matrix, shape
        (states, m), with them. `pushes` has the matrices, and the samples of all pushes, shape (n m,).
        """
        rows = -(-n // STRETCH)
        states = np.zeros((STRETCH, len(self._A), rows))  # after each push, of all stretches side by side
        for into, samples in pushes:
            each = np.zeros((rows, STRETCH, into.shape[1]))
            each.reshape(-1)[: samples.size] = samples
            states += into @ each.transpose(1, 2, 0)
        for before, after in pairwise(states):  # every stretch as if it began at rest
            after += self._A @ before
        begun = np.concatenate([state[:, None], states[-1]], axis=1)
        for k, over in enumerate(self._over):  # now each holds what the 2^k stretches before it made
            begun[:, 2**k :] += over @ begun[:, : -(2**k)]
        seen = (self._later @ begun[:, :-1]).reshape(STRETCH, -1, rows)
        seen[1:] += self._C @ states[:-1]
        return seen.transpose(1, 2, 0).reshape(-1, rows * STRETCH)[:, :n], begun[:, -1]


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
    H = transfer(s, run.h, frequency, rows)
    shares, psd = streams(run, s, frequency)
    G = H @ shares
    return np.asarray(np.einsum("nik,nk,njk->nij", G.conj(), psd, G, optimize=True))


def transfer(s: System, h: float, frequency: Array, rows: Sequence[int] | None = None) -> Complex:
    """Give the frequency responses of the channels to the inputs, shape (n, channels, inputs).

    Parameters
    ----------
    s : System
        Of the loop.
    h : float
        Its sample time [s].
    frequency : ndarray, shape (n,)
        Hz.
    rows : sequence of int, optional
        Which channels, all by default.
    """
    which = slice(None) if rows is None else list(rows)
    z = on_circle(frequency, h)
    states = np.linalg.solve(z * np.eye(len(s.A)) - s.A, s.B.astype(complex))
    return np.asarray(s.C[which].astype(complex) @ states + s.D[which])


def streams(run: Run, s: System, frequency: Array) -> tuple[Array, Array]:
    """Give the independent streams of noise that drive a loop.

    Returns
    -------
    shares : ndarray, shape (inputs, streams)
        What of each stream goes into the inputs of `s`.
    psd : ndarray, shape (n, streams)
        One-sided PSDs of the streams; those that go the same ways are one. Noise of the electrodes acts as
        a force; times a command, it counts as times the rms that this is expected to have over the run.
    """
    found: dict[Weights, Array] = {}
    enters = {name: (into, 1.0) for name, into in _ENTERS.items()}
    if run.actuation != Actuation():
        enters |= electrodes.felt(run, expected_rms(run))
    for source in world_of(run).sources(run):
        ways = [(*enters.get(name, (name, 1.0)), factor) for name, factor in source.shares]
        into = tuple((name, own * factor) for name, own, factor in ways)
        found[into] = found.get(into, 0.0) + source.psd(frequency, run.h)
    of_each = [dict(into) for into in found]
    shares = np.array([[of.get(name, 0.0) for of in of_each] for name in s.inputs])
    return shares, np.stack(list(found.values()), axis=1)


def expected_rms(run: Run) -> tuple[float, float]:
    """Return the rms over a run of the commands f_x_1 and f_x_2 that injections and dc call for [m s^-2]."""
    moved = response(replace(run, actuation=Actuation()))
    f_x_2 = moved["f_x_2"] + run.f_x_2_start
    return float(np.sqrt(np.mean(moved["f_x_1"] ** 2))), float(np.sqrt(np.mean(f_x_2**2)))
