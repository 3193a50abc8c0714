"""Runs that are not what their labels say: copies of others, noise runs with injections or of other settings.

Two runs may share their injections but never their noise. What is compared is the phase of every bin of a
read-out above the injections, each bin of one weight, first lag by lag, and then block by block: what edges
of the same injection have in common is in a few of these, a copy in nearly all.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, groupby
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.campaign import Campaign
from fit.findings import Finding
from fit.parallel import parallel_map
from fit.statistics import injections
from fit.whitening import Experiment, Run

LENGTH = 2**15  # samples that are compared, 9 h at 1 Hz
BAND = (0.07, 0.2)  # Hz: above what is injected, below where archives at 1 Hz have nothing left
MEDIAN_BINS = 101  # bins, over which the level is a median
TONE = 10.0  # of that level: what is higher is no noise
MAX_DEVIATION = 10.0  # median deviations; a few wild samples must not hide the rest
#: Correlation of phases at the best lag; independent noise gives 0.06, equal edges up to 0.26.
MIN_PHASE_CORRELATION = 0.15
BLOCK = 512  # samples; a copy is one nearly everywhere
MIN_BLOCK_CORRELATION = 0.5  # median over the blocks; independent noise gives 0 within 0.06
MIN_SAMPLES = 4 * BLOCK
#: ASD of o_12 in `BAND` [m Hz^-1/2] of telemetry without noise, alike wherever its injections are; in flight
#: 3.5e-14.
NOISE_FREE = 5e-15
SETTINGS = ("F_max_1", "F_max_2", "N_max_1", "N_max_2", "alignment_epoch")  # equal in a run and its noise run


def find(campaign: Campaign) -> list[Finding]:
    """Return which runs are copies of others, or noise runs that are none, or of other settings."""
    findings = [*_duplicates(campaign.candidates), *campaign.find_each(_settings_mismatches)]
    return [*findings, *campaign.find_each(_noise_runs_with_injections)]


def _settings_mismatches(e: Experiment) -> Iterator[Finding]:
    """Yield the attribute in which a noise run differs from the run whose noise it should be."""
    noise, sysid = (e.noise or e.sysid).telemetry, e.sysid.telemetry
    for key in SETTINGS:
        value, expected = getattr(noise, key), getattr(sysid, key)
        if not math.isclose(value, expected, rel_tol=1e-6):
            message = (
                f"{noise.path}: attribute {key}: {value:g}, expected {expected:g} as in {sysid.path}, whose "
                "noise run it is"
            )
            yield Finding("invalid_data", message, noise.run, key)
            return


def _noise_runs_with_injections(e: Experiment) -> Iterator[Finding]:
    """Yield the wrong label of the noise run of an experiment that holds injections."""
    if e.noise and injections.has_injections(e.noise, e.sysid):
        run = e.noise.telemetry
        message = f"{run.path}: attribute kind: 'noise', but the run contains injections, expected 'sysid'"
        yield Finding("invalid_data", message, run.run, "kind")


def _duplicates(experiments: Sequence[Experiment]) -> Iterator[Finding]:
    """Yield the experiments that hold samples of another run, or of another of their own."""
    owners = [(e, run) for e in experiments for run in e.runs]
    pairs = sorted(duplicate_pairs([run for _, run in owners]), key=lambda pair: (pair.runs, pair.channel))
    excluded: set[str] = set()
    for (i, j), group in groupby(pairs, key=lambda pair: pair.runs):
        readouts = list(group)
        (e, a), (copy, b) = owners[i], owners[j]
        if excluded & {e.name, copy.name}:
            continue
        names = _mislabelled_owners(e, a, copy, b, whole=len(readouts) == 2)
        excluded |= set(names)
        late = f", {abs(readouts[0].lag):g} s {'later' if readouts[0].lag > 0 else 'earlier'}"
        message = (
            f"{b.telemetry.path}: {' and '.join(pair.channel for pair in readouts)}: the same noise as in "
            f"{a.telemetry.path}{late * (readouts[0].lag != 0)}: {b.telemetry.run} and {a.telemetry.run} "
            "cannot be two runs"
        )
        channels = " ".join(pair.channel for pair in readouts)
        yield from (Finding("invalid_data", message, name, channels) for name in names)


def _mislabelled_owners(e: Experiment, a: Run, copy: Experiment, b: Run, *, whole: bool) -> list[str]:
    """Return the experiments to leave out for two runs that share their noise.

    Which of two that state different things is right is not known: then both are left out.
    """
    kinds = a.telemetry.kind, b.telemetry.kind
    if e is copy:
        return [e.name]
    if kinds[0] != kinds[1]:  # a noise run that is another experiment, or an experiment that is noise
        sysid, noise = (e, copy) if kinds[0] == "sysid" else (copy, e)
        is_sysid = sysid.noise is None or injections.has_injections(sysid.sysid, sysid.noise)
        return [noise.name if is_sysid else sysid.name]
    if whole and all(getattr(a.telemetry, key) == getattr(b.telemetry, key) for key in SETTINGS):
        return [copy.name]
    return [e.name, copy.name]


class DuplicatePair(NamedTuple):
    """Two runs by index, in their order, a read-out of which is the same noise, and by what it lags [s]."""

    runs: tuple[int, int]
    channel: str
    lag: float


@dataclass(frozen=True)
class _Fingerprint:
    """Noise of a read-out of a run.

    Attributes
    ----------
    run : int
        Index of the run.
    fs : float
        Its sample rate [Hz].
    n_samples : int
        That are compared.
    asd : float
        Of the read-out at the centre of `BAND` [m Hz^-1/2].
    bins : ndarray, shape (LENGTH / 2 + 1,)
        Fourier transform over the root of its smooth power in `BAND`, else zero.
    """

    run: int
    fs: float
    n_samples: int
    asd: float
    bins: NDArray[np.complex64]


def duplicate_pairs(runs: Sequence[Run]) -> Iterator[DuplicatePair]:
    """Yield every two runs, and the read-out, that hold the same noise."""
    sampled = [(n, run) for n, run in enumerate(runs) if run.channels.fs > 2 * BAND[1]]
    names = [name for _, run in sampled for name in run.spacecraft.read_outs]
    noisy: set[int] = set()
    for channel in dict.fromkeys(names):
        fingerprints = [p for p in parallel_map(partial(_fingerprint, channel), sampled) if p is not None]
        if channel == names[0]:  # the quietest
            noisy = {p.run for p in fingerprints if p.asd > NOISE_FREE}
        for a, b in combinations((p for p in fingerprints if p.run in noisy), 2):
            if a.fs == b.fs and (lag := _common_lag(a, b)) is not None:
                yield DuplicatePair((a.run, b.run), channel, lag / a.fs)


def _fingerprint(channel: str, indexed_run: tuple[int, Run]) -> _Fingerprint | None:
    """Return the noise of a read-out of a run with its index; None where there is none to compare."""
    n, run = indexed_run
    x, fs = np.diff(run.channels.series[channel][:LENGTH], 2), run.channels.fs
    limit = MAX_DEVIATION * float(np.median(np.abs(x - np.median(x))))
    if x.size < MIN_SAMPLES or limit == 0:
        return None
    x = np.clip(x, -limit, limit)
    band = slice(*(math.ceil(edge * LENGTH / fs) - k for k, edge in enumerate(BAND)))
    X = scipy.fft.rfft(x * scipy.signal.windows.tukey(x.size, 0.1), LENGTH)[band]
    power = np.abs(X) ** 2
    level = scipy.ndimage.median_filter(power, MEDIAN_BINS, mode="nearest")
    noise = power < TONE * level
    if not (np.all(level > 0) and noise.any()):
        return None
    bins = np.zeros(LENGTH // 2 + 1, dtype=np.complex64)
    bins[band] = np.where(noise, X / np.sqrt(level), 0)
    # the median of blocks: an injection begins or ends in few of them
    f, psd = scipy.signal.welch(x, fs, nperseg=BLOCK, average="median")
    asd = math.sqrt(float(np.median(psd[(f >= BAND[0]) & (f <= BAND[1])])))
    return _Fingerprint(n, fs, x.size, asd / (2 * math.sin(math.pi * np.mean(BAND) / fs)) ** 2, bins)


def _common_lag(a: _Fingerprint, b: _Fingerprint) -> int | None:
    """Return the lag of b, in samples, at which it holds the noise of a; None if it does not.

    What correlates best is looked at lag by lag in phase, and then block by block.
    """
    cross = b.bins * a.bins.conj()
    size = np.abs(cross)
    by_lag = scipy.fft.irfft(cross / np.where(size > 0, size, 1), LENGTH)
    peak = int(np.argmax(np.abs(by_lag)))
    if abs(by_lag[peak]) * LENGTH / 2 < MIN_PHASE_CORRELATION * np.count_nonzero(size):
        return None
    lag = peak if peak < LENGTH // 2 else peak - LENGTH
    x, y = scipy.fft.irfft(a.bins, LENGTH), scipy.fft.irfft(b.bins, LENGTH)
    x, y = x[max(0, -lag) : a.n_samples], y[max(0, lag) : b.n_samples]
    n_blocks = min(x.size, y.size) // BLOCK
    x, y = (z[: n_blocks * BLOCK].reshape(n_blocks, BLOCK) for z in (x, y))
    products = np.sum(x * y, axis=1) / np.sqrt(np.sum(x * x, axis=1) * np.sum(y * y, axis=1))
    return lag if n_blocks > 1 and abs(np.median(products)) > MIN_BLOCK_CORRELATION else None
