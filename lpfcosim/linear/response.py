"""What a run is expected to record, without simulating it: its response to the injections, and its noise.

Both are those of the linear closed loop, with no command at its limit. Of what is quadratic in the motion of
the whole spacecraft there is what is linear about its steady turn: a rate that adds to it pulls along x.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lpfcosim.linear.closed_loop import ClosedLoop
from lpfcosim.linear.state_space import StateSpace
from lpfcosim.models import ELECTRODES, model_of
from lpfcosim.signals import Noise, Weights, commanded, decimation
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

RATE = 1.0  # Hz, of the response; nothing of it lies above half of that
CHUNK = 30  # samples of what is returned, stepped side by side
BLOCK = 120 * CHUNK  # samples, held in memory: whole chunks


def recorded_system(run: Run, channels: Sequence[str] | None = None) -> StateSpace:
    """Return the linear closed loop of a run from its signals from outside to its recorded channels."""
    system = ClosedLoop(run).linearize()
    names = model_of(run).record if channels is None else channels
    return system.select(system.inputs, [name for name in names if name in system.outputs]).observable()


def linear_response(
    run: Run,
    noise: Noise | None = None,
    rate: float = RATE,
    *,
    channels: Sequence[str] | None = None,
    low_pass: bool = False,
) -> dict[str, Array]:
    """Return what the injections make of the channels.

    Parameters
    ----------
    run : Run
        What is injected, and into what.
    noise : Noise, optional
        To be there too; none otherwise.
    rate : float
        Of what is returned [Hz], which the sample rate of the run is a multiple of.
    channels : sequence of str, optional
        Outputs of the models, by default all that are recorded, which takes several times as long.
    low_pass : bool
        Low-pass the channels as archives of this rate are: abrupt injections alias otherwise.

    Returns
    -------
    dict of str to ndarray, shape (n_samples rate / fs,)
        Departures of the channels from the equilibrium, SI.
    """
    system = recorded_system(run, channels)
    stride = round(run.fs / rate)
    n = run.n_samples // stride
    driving: set[str] = {injection.into for injection in run.injections}
    if noise:
        driving |= set(system.inputs) - set(model_of(run).attitude_rates(run))  # the equilibrium turns
    system = system.select([name for name in system.inputs if name in driving], system.outputs)
    columns = {name: i for i, name in enumerate(system.inputs)}
    series = np.zeros((len(system.outputs), n))
    if not columns:
        return dict(zip(system.outputs, series, strict=True))
    # what the samples of injections from one returned sample to the next make of the states
    powers = [system.B]
    for _ in range(stride - 1):
        powers.append(system.A @ powers[-1])
    weights = np.stack(powers[::-1], axis=1)
    recursion = _Recursion(np.linalg.matrix_power(system.A, stride), system.C)
    state = np.zeros(len(system.A))
    taps = decimation.taps(stride) if low_pass else np.ones(1)
    for begin, end, signals in _blocks(run, noise, stride, taps):
        driven = {i: signals[name] for name, i in columns.items() if name in signals}
        block, state = recursion.advance(
            state, end - begin, ((weights[:, :, i], x) for i, x in driven.items())
        )
        series[:, begin:end] = block
        for i, x in driven.items():
            for k in np.flatnonzero(system.D[:, i]):
                series[k, begin:end] += x[::stride] * system.D[k, i]
    return dict(zip(system.outputs, series, strict=True))


def _blocks(
    run: Run, noise: Noise | None, stride: int, taps: Array
) -> Iterator[tuple[int, int, dict[str, Array]]]:
    """Yield the signals from outside that are not zero, block by block, filtered by symmetric taps.

    The loop is linear: filtered signals make of it the filtered channels. Beyond the run signals are zero.
    """
    half, n = taps.size // 2, run.n_samples // stride
    drawn: dict[str, Array] = {}  # from half a filter before the block on
    for begin in range(0, n, BLOCK):
        end = min(begin + BLOCK, n)
        start, stop = begin * stride - half, end * stride + half
        lower, upper = max(start, 0), min(stop, n * stride)
        padding = lower - start, stop - upper
        signals = commanded(run.injections, run.fs, lower, upper)
        if noise:
            n_drawn = next(iter(drawn.values())).size if drawn else 0
            new = noise.take(upper - lower - n_drawn)
            if run.dc:
                new["g_2"] -= run.dc  # the equilibrium holds it
            drawn = {name: np.concatenate([drawn.get(name, x[:0]), x]) for name, x in new.items()}
            signals |= drawn
            drawn = {name: x[max(end * stride - half, 0) - lower :] for name, x in drawn.items()}
        signals = {name: x for name, x in signals.items() if x.any()}
        if half:
            signals = {
                name: np.convolve(np.pad(x, padding), taps, mode="valid") for name, x in signals.items()
            }
        yield begin, end, signals


class _Recursion:
    """Steps ``state+ = A state + push``, many chunks of a run side by side, and returns ``C state``."""

    def __init__(self, A: Array, C: Array) -> None:
        self._A, self._C = A, C
        outputs = [C]
        for _ in range(CHUNK - 1):
            outputs.append(outputs[-1] @ A)
        self._outputs = np.concatenate(outputs)
        self._powers = [np.linalg.matrix_power(A, CHUNK)]  # then that of two chunks, of four ...
        while 2 ** len(self._powers) <= BLOCK // CHUNK:
            self._powers.append(self._powers[-1] @ self._powers[-1])

    def advance(self, state: Array, n: int, pushes: Iterable[tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return the outputs before each of n pushes, shape (S, n), and the state a whole BLOCK later.

        A push is the sum of what every signal makes of m samples, the product of its matrix, shape
        (states, m), with them. `pushes` has the matrices, and the samples of all pushes, shape (n m,).
        """
        rows = -(-n // CHUNK)
        states = np.zeros((CHUNK, len(self._A), rows))  # after each push, of all chunks side by side
        for weight, samples in pushes:
            chunks = np.zeros((rows, CHUNK, weight.shape[1]))
            chunks.reshape(-1)[: samples.size] = samples
            states += weight @ chunks.transpose(1, 2, 0)
        for previous, current in pairwise(states):  # every chunk as if it began at rest
            current += self._A @ previous
        starts = np.concatenate([state[:, None], states[-1]], axis=1)
        for k, power in enumerate(self._powers):  # now each holds what the 2^k chunks before it made
            starts[:, 2**k :] += power @ starts[:, : -(2**k)]
        outputs = (self._outputs @ starts[:, :-1]).reshape(CHUNK, -1, rows)
        outputs[1:] += self._C @ states[:-1]
        return outputs.transpose(1, 2, 0).reshape(-1, rows * CHUNK)[:, :n], starts[:, -1]


def peaks(run: Run) -> dict[str, float]:
    """Return the largest magnitude of each recorded output without noise, by channel, SI."""
    level = ClosedLoop(run).equilibrium()
    return {name: float(np.abs(x + level[name]).max()) for name, x in linear_response(run).items()}


def noise_system(run: Run) -> StateSpace:
    """Return the linear closed loop that noise passes through, from stimuli to all outputs.

    Noise of the electrodes multiplies commands: it counts as times the rms that these are expected to have
    over the run, which is right for a command that is slow compared with the noise.
    """
    commands = expected_rms(run) if any(map(run.level, ELECTRODES)) else {}
    return ClosedLoop(run).linearize(commands)


def cross_spectra(run: Run, channels: Sequence[str], frequency: Array) -> Complex:
    """Return the cross-spectral matrices of the noise of channels, ``<x_i^* x_j>``, one-sided.

    Parameters
    ----------
    run : Run
        Where loop and noise come from.
    channels : sequence of str
        C outputs of the models.
    frequency : ndarray, shape (n,)
        Hz.

    Returns
    -------
    ndarray, shape (n, C, C)
        Products of the units per Hz.
    """
    system = noise_system(run)
    weights, psd = noise_streams(run, system, frequency)
    G = system.select(system.inputs, channels).frequency_response(frequency) @ weights
    return np.asarray(np.einsum("nik,nk,njk->nij", G.conj(), psd, G, optimize=True))


def noise_streams(run: Run, system: StateSpace, frequency: Array) -> tuple[Array, Array]:
    """Return the independent streams of noise that drive a loop.

    Returns
    -------
    weights : ndarray, shape (inputs, streams)
        What of each stream goes into the inputs of `system`.
    psd : ndarray, shape (n, streams)
        One-sided PSDs of the streams; those that go the same ways are one.
    """
    spectra: dict[Weights, Array] = {}
    for source in model_of(run).sources(run):
        spectra[source.shares] = spectra.get(source.shares, 0.0) + source.psd(frequency, run.h)
    streams = [dict(shares) for shares in spectra]
    weights = np.array([[shares.get(name, 0.0) for shares in streams] for name in system.inputs])
    return weights, np.stack(list(spectra.values()), axis=1)


def expected_rms(run: Run) -> dict[str, float]:
    """Return the rms over a run of the commands that injections and dc call for, by channel, SI."""
    undriven = run.without_noise(*ELECTRODES)
    loop = ClosedLoop(undriven)
    response, level = linear_response(undriven, channels=list(loop.commands)), loop.equilibrium()
    return {name: float(np.sqrt(np.mean((response[name] + level[name]) ** 2))) for name in loop.commands}
