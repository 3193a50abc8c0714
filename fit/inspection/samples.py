"""Samples of one channel that no instrument gives: stuck, filled in, repeated, rounded, jumping.

All of it is seen in the channel alone, at the rate of its archive. A body does not jump: of a read-out a
jump or a wild sample is a fault whatever the forces. Commands may jump, and stay the same where nothing feeds
them back; of these only what noise makes impossible is one.
"""

from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fit.inspection import authority
from fit.model import dynamics
from fit.signal import derivatives, median
from fit.telemetry import Row, Telemetry, pieces

Array = NDArray[np.float64]

READ_OUTS = ("o_1", "o_12")
STRAIGHT, LONG = 6, 30  # samples in a row on a straight line, where there is noise; of rounded values
COARSE = 0.1  # of the increments: where values are rounded so much, equal ones come by themselves
BETWEEN = 0.1  # share of samples on the line between their neighbours, where noise puts none
COMB, OFTEN, TEETH = 16, 80, 8000  # samples between those of a comb, fewest of a comb, looked at for combs
STRAIGHTER = 0.1  # second differences of a comb that is made from its neighbours, over those of all
WHOLE = 0.9  # share of second differences that count as they are
LOOKED, FEW = 20000, 0.6  # samples in which values are counted, and the share of different ones that is few
SMALLEST, BEGUN = 200, 4000  # increments that tell whether values are rounded, and those looked at first
BUCKETS = 17  # bits of the numbers by which different values are told apart
SETTLED = 60.0  # s at either end: a loop may start from exact zeros, an archive end on them
COINCIDENCE = 1e-5  # probability below which equal neighbours are no chance
NEAR = 1e-3  # share of the increments that tells how many are about zero
BLOCK = 500  # samples over which noise is compared
TOGETHER = 256 * BLOCK  # samples that are in memory at a time
JUMP, WILD = 20.0, 200.0  # standard deviations of what noise does; wild samples up to here are masked
ISOLATED = 8.0  # times what is beside it
SUSPECT = 5.5  # standard deviations of second differences, which are 15 of those of a jump
TURNED = 0.05  # of a jump: so little its ends may differ in size where only the sign changes
_GAUSSIAN = 1.4826  # standard deviation over median absolute deviation


_Sizes = Callable[[slice], Array]  # what is found at a stretch of samples, made when it is asked for


@dataclass(frozen=True)
class Oddity:
    """What is odd about a channel.

    Attributes
    ----------
    what : str
        In words that follow the name of the channel.
    begin, end : float
        Where, seconds since the start of the run.
    again : bool
        Whether it is no more than samples repeated.
    """

    what: str
    begin: float
    end: float
    again: bool = False


def step(x: Row) -> float:
    """Return the step to which values are rounded, 0 if the smallest increments do not tell one."""
    d, most = np.empty(0), np.inf
    for piece in pieces(x.size, overlap=1):
        increments = np.abs(np.diff(x[piece]))
        for more in np.split(increments, [BEGUN]):  # the first few leave hardly any of the others
            d = np.concatenate([d, more[(more > 0) & (more < most)]])
            if d.size > SMALLEST:
                d = np.partition(d, SMALLEST)[:SMALLEST]
                most = d.max()
    if not d.size:
        return 0.0
    d.sort()
    for part in (1, 2, 3, 4):
        multiples = d * (part / d[0])
        if np.all(np.abs(multiples - np.round(multiples)) < 0.02):
            return float(d[0] / part)
    return 0.0


def _digit(large: Array) -> float:
    """Return the last digit of the largest values, 0 if they have none; of floating point it grows."""
    digit = step(large) if large.size > SMALLEST else 0.0
    if not digit:
        return 0.0
    multiples = (large - large[0]) / digit  # a slope makes increments alike, values not
    return digit if np.all(np.abs(multiples - np.round(multiples)) < 0.02) else 0.0


def is_noisy(x: Row) -> bool:
    """Tell whether a channel changes nearly always, as noise makes it."""
    parts = (x[piece] for piece in pieces(x.size, overlap=1))
    return sum(int(np.count_nonzero(part[1:] == part[:-1])) for part in parts) < 0.5 * (x.size - 1)


def _extremes(x: Row) -> tuple[float, float]:
    """Return the least and the largest value of a channel."""
    ends = [(np.fmin.reduce(part), np.fmax.reduce(part)) for part in (x[piece] for piece in pieces(x.size))]
    return float(np.nanmin(ends)), float(np.nanmax(ends))


def stuck(x: Row, fs: float) -> Iterator[Oddity]:
    """Yield where a channel that should be noise is constant, on a straight line, rounded or repeated."""
    looked, rounded = x[:LOOKED], step(x)
    if not is_noisy(x):
        least, most = _extremes(x)
        what = (
            f"is stuck at {looked[0] + 0.0:.4g} throughout"
            if least == most
            else f"is rounded to steps of {rounded:.2g}"
            if rounded > 0
            else "is more often constant than not"
        )
        yield Oddity(what, 0.0, x.size / fs)
        return
    if (different := _different(looked)) < FEW * looked.size:
        what = f"is rounded: it has {different} values in {looked.size} samples"
        if again := _period(looked):
            what = f"comes again every {again / fs:g} s"
        if again or rounded == 0:
            yield Oddity(what, 0.0, x.size / fs)
            return
    typical = np.abs(_bends(x)(slice(0, LOOKED)))
    usual = median(typical[~np.isnan(typical)])
    size = np.abs(looked)
    digit = _digit(looked[size > np.nanmax(size) / 2])
    if digit > max(2 * rounded, COARSE * usual):
        yield Oddity(f"is rounded: to steps of {digit:.2g} where it is largest", 0.0, x.size / fs)
        return
    if rounded > 0 and rounded > COARSE * float(np.nanmedian(np.abs(np.diff(looked)))):
        return  # equal values come by themselves
    if rounded == 0 and (share := _between(typical, np.nanmax(size))) > BETWEEN:
        what = f"is interpolated: {100 * share:.0f} % of its samples lie on the line between their neighbours"
        yield Oddity(what, 0.0, x.size / fs)
        return
    kept = _flat(x, max(2.1 * rounded, 1e-9 * usual), rounded)
    for begin, end in kept:
        part = x[begin : end + 2]
        constant = np.ptp(part) <= 2.1 * rounded
        extreme = constant and part[0] in _extremes(x)
        how = "stops at its limit of" if extreme else "is stuck at"
        what = f"{how} {part[0] + 0.0:.4g}" if constant else "is a straight line"
        yield Oddity(f"{what} for {(end + 2 - begin) / fs:g} s", begin / fs, (end + 2) / fs)
    if rounded == 0 and not len(kept):
        yield from _repeated(x, fs)


def _different(x: Array) -> int:
    """Return how many different values there are, or once there are many a number that is no larger."""
    bits = (x + 0.0).view(np.uint64)  # zero has one sign
    found = np.zeros(2**BUCKETS, dtype=bool)
    found[(bits * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(64 - BUCKETS)] = True
    at_least = int(np.count_nonzero(found))
    return at_least if at_least >= FEW * x.size else np.unique(x).size


def _period(x: Array) -> int:
    """Return after how many samples a channel begins anew; 0 if it does not within half of them."""
    at = np.flatnonzero(x[1 : x.size // 2] == x[0]) + 1
    return next((int(n) for n in at if np.array_equal(x[n:], x[:-n], equal_nan=True)), 0)


def _between(bends: Array, largest: float) -> float:
    """Return the share of samples that lie on the line between their neighbours, a few in a row at most."""
    line = bends <= max(1e-9 * float(np.nanmax(bends)), 4 * float(np.spacing(largest)))
    length = np.diff(derivatives.stretches(line), axis=1)
    return float(np.sum(length[length < STRAIGHT - 2])) / bends.size


def interpolated(run: Telemetry) -> Iterator[str]:
    """Yield the channels of which every so-and-so-many-th sample is made from its neighbours.

    Rounding puts samples on the line between their neighbours here and there, hardly ever all of a comb.
    """
    for name in dynamics.CHANNELS:
        if comb := _comb(run.row(name)[:TEETH]):
            how = f"one sample in every {comb} lies on the line between its neighbours"
            yield f"{run.path}: {name} is interpolated: {how}"


def _comb(x: Array) -> int:
    """Return after how many samples one that is interpolated comes again; 0 if none does."""
    if not is_noisy(x):
        return 0
    bends = np.abs(_bends(x)(slice(0, x.size)))
    at = int(WHOLE * np.count_nonzero(np.isfinite(bends)))
    bends = np.fmin(bends, np.partition(bends, at)[at])  # what jumps is in few of the combs
    usual = float(bends.mean())
    lines = scipy.fft.rfft(bends)[bends.size // COMB :]  # slower ones are those of injections
    if np.abs(lines).max() < 0.6 * usual * bends.size / COMB:
        return 0  # no comb stands out: those of noise are compared for nothing
    for period in range(2, min(COMB, bends.size // OFTEN) + 1):
        of_each = bends[: bends.size // period * period].reshape(-1, period).mean(axis=0)
        if of_each.min() < STRAIGHTER * usual:
            return period
    return 0


def _flat(x: Row, least: float, rounded: float) -> NDArray[np.intp]:
    """Return the stretches in which second differences stay within `least`, shape (number of them, 2)."""
    found = derivatives.stretches_of(np.abs(_bends(x)(piece)) <= least for piece in pieces(x.size - 2))
    return found[found[:, 1] - found[:, 0] >= (STRAIGHT if rounded == 0 else LONG) - 2]


def _repeated(x: Row, fs: float) -> Iterator[Oddity]:
    edge = int(SETTLED * fs)
    at, same = pieces(x.size - 2 * edge, overlap=1), []
    for start, part in ((edge + piece.start, x[edge + piece.start : edge + piece.stop]) for piece in at):
        same.append(start + np.flatnonzero(part[1:] == part[:-1]) + 1)
    again = np.concatenate([np.zeros(0, dtype=np.intp), *same])
    if not again.size or scipy.special.pdtrc(again.size - 1, _coincidences(x[:])) > COINCIDENCE:
        return
    zero = x[:][again] == 0
    for which, what in ((again[zero], "is exactly 0"), (again[~zero], "repeats a sample")):
        if which.size:
            often = f" {which.size} times, first" * (which.size > 1)
            yield Oddity(f"{what}{often}", which[0] / fs, which[-1] / fs, again=True)


def _coincidences(x: Array) -> float:
    """Return how many neighbours to expect to be equal by chance, from the digits that values have."""
    values, increments = x[np.isfinite(x)], np.abs(np.diff(x))
    most = values[np.argmax(np.abs(values))]
    if np.all(values[:LOOKED] == values[:LOOKED].astype(np.float32)):
        digit = float(np.spacing(np.float32(most)))
    else:
        looked = values[: LOOKED : LOOKED // 200]
        digits = next((d for d in range(5, 16) if all(float(f"{v:.{d}e}") == v for v in looked)), 16)
        digit = 10.0 ** (np.floor(np.log10(abs(most))) - digits)
    near = float(np.nanquantile(increments[increments > 0], NEAR))
    return float(increments.size * NEAR * digit / (2 * near))


def jumps(x: Row, fs: float) -> Iterator[Oddity]:
    """Yield the largest jump or wild sample of a read-out, if noise does not explain it, nor a force."""
    filled, half = x, max(5, round(1.5 * fs))
    lost, masked = np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
    if any(np.isnan(x[piece]).any() for piece in pieces(x.size)):
        lost = np.isnan(x[:])
        filled, masked = derivatives.bridge(x[:], fs)
    if _largest(_bends(filled), x.size - 2, SUSPECT) is None:
        return
    left, bad = _left(half), lost | masked
    reached = np.convolve(bad, np.ones(2 * half + 1), mode="valid") > 0.5 if bad.any() else None
    for name, limit in (("jumps by", JUMP), ("is off by", WILD)):
        size = _sizes(filled, left[name] / (left[name] @ left[name]), reached)
        at = _largest(size, x.size - 2 * half, limit)
        if at is None or not _stands_alone(size, x.size - 2 * half, at, half):
            continue
        near = filled[max(0, at - half) : at + 3 * half + 1]
        found = {
            k: np.abs(np.correlate(near, w, mode="valid")).max() / np.linalg.norm(w) for k, w in left.items()
        }
        if max(found, key=lambda k: float(found[k])) == name:
            before, after = (float(filled[part].mean()) for part in _beside(at + half))
            turned = name == "jumps by" and abs(before + after) < TURNED * abs(before - after)
            so_much = float(size(slice(at, at + 1))[0])
            what = f"{'changes its sign and ' * turned}{name} {so_much:.2g} m"
            yield Oddity(what, (at + half) / fs, (at + half) / fs)


#: A jump, a wild sample, and what no body does without a force of its own, at the sample in the middle.
_SHAPES: Mapping[str, Callable[[NDArray[np.intp]], Array]] = {
    "jumps by": lambda n: 0.5 * np.sign(n - 0.5),
    "is off by": lambda n: 1.0 * (n == 0),
    "turns": lambda n: np.maximum(n, 0.0),
}


@lru_cache(maxsize=4)
def _left(half: int) -> Mapping[str, Array]:
    """Return what the shapes leave once a cubic has been fitted to all, each of shape (2 half + 1,)."""
    n = np.arange(-half, half + 1)
    cubic = (n / half) ** np.arange(4)[:, None]
    return {k: shape(n) - cubic.T @ np.linalg.lstsq(cubic.T, shape(n))[0] for k, shape in _SHAPES.items()}


def _beside(at: int) -> tuple[slice, slice]:
    """Return the few samples up to one, and those after it."""
    return slice(at - 2, at + 1), slice(at + 1, at + 4)


def _bends(x: Row) -> _Sizes:
    """Return the second differences of a channel."""
    return lambda at: np.diff(x[at.start : at.stop + 2], 2)


def _sizes(x: Row, weights: Array, reached: NDArray[np.bool_] | None) -> _Sizes:
    """Return what a stencil finds in a channel, zero where it is `reached` by what is missing."""

    def found(at: slice) -> Array:
        size = _correlated(x[at.start : at.stop + weights.size - 1], weights)
        return size if reached is None else np.where(reached[at], 0.0, size)

    return found


def _correlated(x: Array, weights: Array) -> Array:
    """Return the valid part of a correlation of finite values; `numpy.correlate` takes four times as long."""
    m = weights.size + 1
    rows = x[: x.size // m * m].reshape(-1, m)
    band = sliding_window_view(np.pad(weights, (m - 1, m + 1)), m)[:, ::-1].copy()  # of two rows: (2 m, m)
    found = (rows[:-1] @ band[:m] + rows[1:] @ band[m:]).ravel()
    return np.concatenate([found, np.correlate(x[found.size :], weights, mode="valid")])


def _largest(size: _Sizes, n: int, limit: float) -> int | None:
    """Return where one of `n` sizes is farthest beyond what noise does about it; None if within the limit."""
    if n < BLOCK:
        return None
    farthest, at = limit, None
    for start in range(0, n, TOGETHER):
        x = size(slice(start, min(start + TOGETHER, n)))
        if lacking := -x.size % BLOCK:  # at the end: there the last ones come again, backwards
            x = np.concatenate([x, size(slice(n - 1 - lacking, n - 1))[::-1]])
        blocks = np.abs(x).reshape(-1, BLOCK)
        # about zero, as a cubic has been taken off; every fifth tells as much
        most = blocks.max(axis=1) / np.maximum(_GAUSSIAN * np.median(blocks[:, ::5], axis=1), 1e-300)
        block = int(np.argmax(most))
        if most[block] > farthest:
            farthest, at = most[block], start + block * BLOCK + int(np.argmax(blocks[block]))
    return None if at is None else min(at, 2 * (n - 1) - at)


def _stands_alone(size: _Sizes, n: int, at: int, half: int) -> bool:
    spans = (max(0, at - 8 * half), max(0, at - 2 * half)), (at + 2 * half, min(at + 8 * half, n))
    beside = [size(slice(*span)) for span in spans if span[0] < span[1]]
    most = max((float(np.abs(x).max()) for x in beside), default=np.inf)
    return bool(abs(float(size(slice(at, at + 1))[0])) > ISOLATED * most)


def faults(sysid: Telemetry, noise: Telemetry | None) -> Iterator[str]:
    """Yield what is wrong with the samples of an experiment and of its noise run."""
    commands = [name for name in dynamics.CHANNELS if name not in READ_OUTS]
    fed = {name for name in commands if noise is not None and is_noisy(noise.row(name))}  # by a loop
    for run in (sysid, noise):
        if run is not None:
            found = {name: _of(run, fed, name) for name in dynamics.CHANNELS}
            begins = [{o.begin for o in oddities if o.again} for oddities in found.values()]
            common = set.intersection(*begins)  # all channels at once: the archive, and the equation holds
            for name, oddities in found.items():
                for o in (o for o in oddities if o.begin not in common):
                    yield f"{run.path}: {name} {o.what} at {o.begin:.7g} s"


def of_commands(run: Telemetry) -> Iterator[str]:
    """Yield jumps and wild samples of commands, which are only faults where the equation fails."""
    for name in ("f_x_1", "f_x_2"):
        for o in jumps(run.row(name), run.fs):
            yield f"{run.path}: {name} {o.what} s-2 at {o.begin:.7g} s"


def _of(run: Telemetry, fed: Container[str], name: str) -> list[Oddity]:
    found: list[Oddity] = []
    if name in READ_OUTS or name in fed:
        x = run.row(name)
        if name in fed and authority.limited(run, name).size:
            # is masked, and no fault of the archive
            x = np.where(authority.at_limit(x[:], authority.limit_of(run, name)), np.nan, x[:])
        found += stuck(x, run.fs)
        if name in READ_OUTS:
            found += jumps(x, run.fs)
    return found
