"""What may be wrong with a part of a run: from some instant on, or between two.

Where a part begins and ends is sought among blocks of a minute by cumulated products of whitened series, for
a step hardly cares whether it comes before or after whitening, and then to the sample. Samples that are lost
or come twice shift what follows by a whole one, which the first order of a lag does not tell.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.consistency.hypotheses import AMOUNT, SOUGHT, Hypothesis, amount, factor_cause, moved
from fit.consistency.trial import Remedy, Trial, of_bins
from fit.spectra import windowing
from fit.warnings import Cause

Array = NDArray[np.float64]

MINUTE = 60.0  # s between the instants at which a part may begin
MOST_BLOCKS = 400
EDGE = 0.03  # of a run: under the flanks of the window a part may begin or end unseen
SCANS = (30.0, 8.0, 2.0, 1.0)  # s between the instants that are tried about them, finer and finer
AROUND = 4  # instants on either side
WORTH = 0.5  # of the best gain of a part, from which another is looked at more closely
BESIDE = 2.0  # s
CLOSELY = 4  # parts that are looked at more closely
SAMPLES = (1, -1)  # of the file, that may be lost or come twice
TURNED = 0.02  # by which a factor may be off a sign or none


@dataclass(frozen=True)
class _Part:
    """A change in the best part of a run: gain, begin and end [s]; infinite where the run begins or ends."""

    gain: float
    begin: float
    end: float

    def holds(self, time: Array) -> NDArray[np.bool_]:
        """Return which instants it has."""
        return (time >= self.begin) & (time < self.end)

    @property
    def ends(self) -> int:
        """How many of its ends are not those of the run."""
        return int(np.isfinite(self.begin)) + int(np.isfinite(self.end))

    @property
    def when(self) -> str:
        """In words."""
        if not np.isfinite(self.begin):
            return f"until {self.end:.0f} s"
        return f"from {self.begin:.0f} s on" + f" until {self.end:.0f} s" * bool(np.isfinite(self.end))


@dataclass(frozen=True)
class _Change:
    """What may be so in a part of a channel.

    `unit`, shape (N,), is what it adds to the channel: in proportion to its amount, or, where it is `exact`,
    just once. `told` makes the cause and what the channel should be of the amount and its sigma.
    """

    channel: str
    unit: Array
    exact: bool
    told: Callable[[float, float], tuple[Cause, Array]]


def parts(trial: Trial, least: float) -> Iterator[Hypothesis]:
    """Yield the hypotheses about parts of a run that lower chi2 by `least` or more."""
    run = trial.sysid.channels
    x = {name: of for name in ("o_1", "o_12", "f_x_1", "f_x_2") if np.ptp(of := getattr(run, name)) > 0}
    found = [(change, _best(trial, change)) for change in _changes(x, run.fs)]
    found.sort(key=lambda one: -one[1].gain)
    for change, part in found[:CLOSELY]:
        if part.gain > max(WORTH * found[0][1].gain, least) and part.ends:
            yield _refined(trial, change, part, x[change.channel])
    for name, of in x.items():
        yield from _jump(trial, name, of)


def _changes(x: Mapping[str, Array], fs: float) -> Iterator[_Change]:
    for name, of in x.items():
        yield _scaled(name, of)
        for n in SAMPLES:
            yield _late(name, of, fs, n)
        yield _drawn_out(name, of, fs)


def _scaled(name: str, x: Array) -> _Change:
    def told(a: float, sigma: float) -> tuple[Cause, Array]:
        if abs(a + 1) < TURNED:
            return Cause("", name, "excess", words=f"{name} contains data that cannot be real"), 0 * x
        cause, factor = factor_cause(name, 1 / (1 + a), sigma / (1 + a) ** 2)
        return cause, x / factor

    return _Change(name, x, exact=False, told=told)


def _late(name: str, x: Array, fs: float, n: int) -> _Change:
    mended = moved(x, fs, n / fs)
    words = f"{name} is {'late' if n > 0 else 'early'} by {abs(n)} sample"

    def told(_: float, __: float) -> tuple[Cause, Array]:
        return Cause("", name, "lag", n / fs, None, "s", words), mended

    return _Change(name, mended - x, exact=True, told=told)


def _drawn_out(name: str, x: Array, fs: float) -> _Change:
    def told(a: float, sigma: float) -> tuple[Cause, Array]:
        words = f"{name} is {'late' if a > 0 else 'early'} by {abs(a):.3g} ± {sigma:.1g} s"
        return Cause("", name, "lag", a, sigma, "s", words), moved(x, fs, float(np.clip(a, -5 / fs, 5 / fs)))

    return _Change(name, np.gradient(x) * fs, exact=False, told=told)


def _best(trial: Trial, change: _Change) -> _Part:
    """Return the part of a run in which a change lowers chi2 most, to a minute."""
    seen = trial.as_it_is
    n = seen.found.window.size
    column = trial.column(change.channel, change.unit)
    both = np.stack([of_bins(column), seen.residual], axis=1)
    d, r = windowing.inverse_transform(both, seen.found.first, n).T * np.sqrt(n / 2)
    size = max(round(MINUTE * seen.terms.fs), -(-n // MOST_BLOCKS))
    starts = np.arange(0, n, size)
    A, b = (np.concatenate([[0.0], np.cumsum(np.add.reduceat(x, starts))]) for x in (d * d, d * r))
    power, product = (x[None, :] - x[:, None] for x in (A, b))
    if change.exact:
        gain = -2 * product - power
    else:
        seen_there = power > 1e-6 * A[-1]
        gain = np.where(seen_there, product**2 / np.where(seen_there, power, 1.0), 0.0)
    gain[np.tril_indices(len(A))] = 0.0
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    edge = EDGE * len(starts)
    begin = -np.inf if i < edge else float(seen.terms.time[starts[i]])
    end = np.inf if j > len(starts) - edge else float(seen.terms.time[starts[j]])
    return _Part(float(gain[i, j]), begin, end)


def _refined(trial: Trial, change: _Change, part: _Part, x: Array) -> Hypothesis:
    """Move the ends of a part to where it takes most, and say what is wrong in it."""
    time = trial.sysid.channels.time

    def tried(begin: float, end: float) -> tuple[_Part, float, float]:
        of_part = np.where((time >= begin) & (time < end), change.unit, 0.0)
        if change.exact:
            gain, a, sigma = trial.with_column(trial.column(change.channel, of_part)), 1.0, 0.0
        else:
            a, sigma, gain = amount(trial, change.channel, of_part)
        return _Part(gain, begin, end), a, sigma

    best = tried(part.begin, part.end)
    for step in SCANS:
        shifts = step * np.arange(-AROUND, AROUND + 1)
        if np.isfinite(part.begin):
            best = max(
                (best, *(tried(best[0].begin + s, best[0].end) for s in shifts)), key=lambda t: t[0].gain
            )
        if np.isfinite(part.end):
            best = max(
                (best, *(tried(best[0].begin, best[0].end + s) for s in shifts)), key=lambda t: t[0].gain
            )
    found, a, sigma = best
    cause, mended = change.told(a, sigma)
    cause = replace(cause, kind=f"{cause.kind} of a part", words=f"{cause.words} {found.when}")
    # there a sample is lost or comes twice
    edges = tuple((edge - BESIDE, edge + BESIDE) for edge in (found.begin, found.end) if np.isfinite(edge))
    channels = {change.channel: np.where(found.holds(time), mended, x)}
    remedy = Remedy(channels, without=edges if change.exact else ())
    return Hypothesis(cause, remedy, AMOUNT + SOUGHT * found.ends)


def _jump(trial: Trial, name: str, x: Array) -> Iterator[Hypothesis]:
    """Try that a channel jumps, where its jump would stand out most."""
    seen, time = trial.as_it_is, trial.sysid.channels.time
    n = seen.found.window.size
    middle = float(seen.terms.time[n // 2])
    column = trial.column(name, np.asarray(time >= middle, dtype=np.float64))
    shape = of_bins(column).conj() * seen.residual
    padded = np.zeros(n // 2 + 1, dtype=np.complex128)
    padded[seen.found.first : seen.found.first + shape.size] = shape
    match = np.abs(scipy.fft.irfft(padded, n)) * (seen.found.window > 0.1)
    at = (int(np.argmax(np.roll(match, n // 2))) - n // 2) / seen.terms.fs + middle
    tried = [
        (amount(trial, name, np.asarray(time >= t, dtype=np.float64)), t)
        for t in at + np.arange(-3, 4) / seen.terms.fs
    ]
    (size, _, _), when = max(tried, key=lambda one: one[0][2])
    unit = "m s-2" if name.startswith("f") else "m"
    words = f"{name} jumps by {abs(size):.2g} {unit} at {when:.0f} s"
    cause = Cause("", name, "jump", size, None, unit, words)
    yield Hypothesis(cause, Remedy({name: x + size * (time >= when)}), AMOUNT + SOUGHT)
