"""Equal samples under two names, whole or channel by channel; shifted, scaled and lightly changed ones too.

Two runs may share their injections but never their noise. What is compared is the phase of every bin of a
read-out above the injections, each bin of one weight. First the powers of the bins about their smooth level
are correlated, which no shift alters; what is alike is looked at lag by lag, and then block by block: what
edges of the same injection have in common is in a few of these, a copy in nearly all.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.parallel import parallel_map
from fit.whitening import Run

Array = NDArray[np.float64]

LENGTH = 2**15  # samples that are compared, 9 h at 1 Hz
BAND = (0.07, 0.2)  # Hz: above what is injected, below where archives at 1 Hz have nothing left
SMOOTH = 101  # bins, over which the level is a median
TONE = 10.0  # of that level: what is higher is no noise
WILD = 10.0  # median deviations; a few wild samples must not hide the rest
LIKELY = 0.05  # correlation of powers; independent noise gives 0.015, equal edges of injections up to 0.15
ALIKE = 0.15  # correlation of phases at the best lag; independent noise gives 0.06, such edges up to 0.26
BLOCK = 512  # samples; a copy is one nearly everywhere
EVERYWHERE = 0.5  # median correlation of the blocks; independent noise gives 0 within 0.06
LEAST = 4 * BLOCK  # samples a run must have
SILENT = (
    5e-15  # m Hz^-1/2 of o_12: telemetry without noise, alike wherever its injections are; in flight 3.5e-14
)


@dataclass(frozen=True)
class Match:
    """A read-out of two runs that holds the same noise.

    Attributes
    ----------
    first, second : int
        Numbers of the runs, in their order.
    channel : str
        The read-out.
    lag : float
        By which the second is late [s].
    gain : float
        Of the second over the first.
    """

    first: int
    second: int
    channel: str
    lag: float
    gain: float


@dataclass(frozen=True)
class _Print:
    """What is kept of a read-out: run, rate, samples, and the bins over their level, with their powers."""

    run: int
    rate: float
    size: int
    level: float
    bins: NDArray[np.complex64]
    powers: NDArray[np.float32]


def matches(runs: Sequence[Run]) -> list[Match]:
    """Return every two runs, and the read-out, that hold the same noise."""
    found: list[Match] = []
    heard = [(n, run) for n, run in enumerate(runs) if run.channels.fs > 2 * BAND[1]]
    for channel in ("o_1", "o_12"):
        prints = [made for made in parallel_map(partial(_print, channel), heard) if made is not None]
        for rate in sorted({p.rate for p in prints}):
            same = [p for p in prints if p.rate == rate]
            powers = np.array([p.powers for p in same])
            for i, j in np.argwhere(np.triu(powers @ powers.T > LIKELY, 1)):
                match = _match(same[i], same[j], channel)
                if match is not None:
                    found.append(match)
    silent = {n: _is_silent(runs[n]) for match in found for n in (match.first, match.second)}
    return [match for match in found if not (silent[match.first] or silent[match.second])]


def _is_silent(run: Run) -> bool:
    """Tell whether a run was simulated without noise, by the typical block of o_12."""
    x, rate = np.diff(run.channels.o_12[:LENGTH], 2), run.channels.fs
    if x.size < LEAST:
        return False
    sos = scipy.signal.butter(4, BAND, "bandpass", fs=rate, output="sos")
    y = scipy.signal.sosfiltfilt(sos, x)
    blocks = y[: y.size // BLOCK * BLOCK].reshape(-1, BLOCK)
    differenced = (2 * np.sin(np.pi * np.mean(BAND) / rate)) ** 2 * np.sqrt(BAND[1] - BAND[0])
    return bool(np.median(blocks.std(axis=1)) < SILENT * differenced)


def _print(channel: str, heard: tuple[int, Run]) -> _Print | None:
    """Return the print of a read-out of a run, by its number; None where there is no noise to compare."""
    n, run = heard
    x, rate = np.diff(getattr(run.channels, channel)[:LENGTH], 2), run.channels.fs
    limit = WILD * float(np.median(np.abs(x - np.median(x))))
    if x.size < LEAST or limit == 0:
        return None
    first, end = (math.ceil(edge * LENGTH / rate) for edge in BAND)
    inside = slice(first, end - 1)
    X = scipy.fft.rfft(np.clip(x, -limit, limit) * _window(x.size), LENGTH)[inside]
    power = np.abs(X) ** 2
    level = scipy.ndimage.median_filter(power, SMOOTH, mode="nearest")
    noise = power < TONE * level
    if not (np.all(level > 0) and noise.any()):
        return None
    bins = np.zeros(LENGTH // 2 + 1, dtype=np.complex64)
    bins[inside] = np.where(noise, X / np.sqrt(level), 0)
    powers = np.where(noise, np.sqrt(power / level), 0)
    powers = np.where(noise, powers - powers[noise].mean(), 0)
    size = float(np.linalg.norm(powers))
    if not size > 0:  # simulated without noise
        return None
    root = math.sqrt(float(np.median(level)) / x.size)
    return _Print(n, rate, x.size, root, bins, (powers / size).astype(np.float32))


@lru_cache(maxsize=8)  # the runs of a campaign have few lengths
def _window(size: int) -> Array:
    return np.asarray(scipy.signal.windows.tukey(size, 0.1), dtype=np.float64)


def _match(a: _Print, b: _Print, channel: str) -> Match | None:
    """Look at two read-outs lag by lag, and at the best one block by block."""
    cross = b.bins * a.bins.conj()
    size = np.abs(cross)
    by_lag = scipy.fft.irfft(np.where(size > 0, cross / np.where(size > 0, size, 1), 0), LENGTH)
    by_lag *= LENGTH / 2 / max(int(np.count_nonzero(size)), 1)
    best = int(np.argmax(np.abs(by_lag)))
    if abs(by_lag[best]) < ALIKE:
        return None
    lag = best if best < LENGTH // 2 else best - LENGTH
    x, y = scipy.fft.irfft(a.bins, LENGTH), scipy.fft.irfft(b.bins, LENGTH)
    x, y = x[max(0, -lag) : a.size], y[max(0, lag) : b.size]
    blocks = min(x.size, y.size) // BLOCK
    x, y = (z[: blocks * BLOCK].reshape(blocks, BLOCK) for z in (x, y))
    products = np.sum(x * y, axis=1) / np.sqrt(np.sum(x * x, axis=1) * np.sum(y * y, axis=1))
    median = float(np.median(products)) if blocks > 1 else 0.0
    if abs(median) < EVERYWHERE:
        return None
    gain = math.copysign(b.level / a.level, median)
    return Match(a.run, b.run, channel, lag / a.rate, gain)
