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

from fit.model import dynamics
from fit.quality import authority, straight
from fit.quality.resolution import Resolution, chance_of_equality, estimate_resolution
from fit.spectra import derivatives
from fit.telemetry import Row, Telemetry, pieces

Array = NDArray[np.float64]

READ_OUTS = ("o_1", "o_12")
STRAIGHT = 6  # samples in a row on a straight line, where there is noise
NEARBY = 33  # samples whose increments tell how likely equal neighbours are
CHANCE, MORE = 0.1, 2.0  # probability up to which equal neighbours are counted, and ratio of more than chance
BETWEEN = 0.1  # share of samples on the line between their neighbours, where noise puts none
FEWEST, MANY = (
    1e-3,
    3.0,
)  # share of samples at which a rounded command of a loop changes, and by how many steps
COMB, OFTEN, TEETH = 16, 80, 8000  # samples between those of a comb, fewest of a comb, looked at for combs
STRAIGHTER = 0.1  # second differences of a comb that is made from its neighbours, over those of all
WHOLE = 0.9  # share of second differences that count as they are
LOOKED, FEW = 20000, 0.6  # samples in which values are counted, and the share of different ones that is few
BUCKETS = 17  # bits of the numbers by which different values are told apart
SETTLED = 60.0  # s at either end: a loop may start from exact zeros, an archive end on them
COINCIDENCE = 1e-5  # probability below which equal neighbours are no chance
NEAR = 1e-3  # share of the increments that tells how many are about zero
BLOCK = 500  # samples over which noise is compared
TOGETHER = 256 * BLOCK  # samples that are in memory at a time
JUMP, WILD = 20.0, 200.0  # standard deviations of what noise does; wild samples up to here are masked
ISOLATED = 8.0  # times what is beside it
STEPS = 4.0  # to which a read-out is rounded, up to which it does not jump
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


def is_noisy(x: Row) -> bool:
    """Tell whether a channel changes nearly always, as noise makes it."""
    parts = (x[piece] for piece in pieces(x.size, overlap=1))
    return sum(int(np.count_nonzero(part[1:] == part[:-1])) for part in parts) < 0.5 * (x.size - 1)


def _extremes(x: Row) -> tuple[float, float]:
    """Return the least and the largest value of a channel."""
    ends = [(np.fmin.reduce(part), np.fmax.reduce(part)) for part in (x[piece] for piece in pieces(x.size))]
    return float(np.nanmin(ends)), float(np.nanmax(ends))


def stuck(x: Row, fs: float, resolution: Resolution | None) -> Iterator[Oddity]:
    """Yield where a channel that should be noise is constant, on a straight line or repeated.

    Parameters
    ----------
    x : Row
        The channel.
    fs : float
        Its sample rate [Hz].
    resolution : Resolution, optional
        Of its numbers: what that explains is no fault.
    """
    looked, noisy = x[:LOOKED], is_noisy(x)
    there = looked[~np.isnan(looked)]  # what is masked is no value
    if not there.size:
        return
    least, most = _extremes(x)
    if least == most or not (noisy or resolution):
        what = (
            f"is stuck at {least + 0.0:.4g} throughout"
            if least == most
            else "is more often constant than not"
        )
        yield Oddity(what, 0.0, x.size / fs)
        return
    if (different := _different(there)) < FEW * there.size:
        again = _period(looked)
        if again or resolution is None:
            what = f"is rounded: it has {different} values in {there.size} samples"
            yield Oddity(f"comes again every {again / fs:g} s" if again else what, 0.0, x.size / fs)
            return
    typical = np.abs(_bends(x)(slice(0, LOOKED)))
    usual = float(np.median(typical[~np.isnan(typical)]))
    if resolution is None and (share := _between(typical, np.nanmax(np.abs(looked)))) > BETWEEN:
        what = f"is interpolated: {100 * share:.0f} % of its samples lie on the line between their neighbours"
        yield Oddity(what, 0.0, x.size / fs)
        return
    lines = _flat(x, 1e-9 * usual) if resolution is None else straight.stretches(x, resolution)
    for begin, end in lines:
        part = x[begin:end]
        constant = np.ptp(part) <= (2.1 * resolution.at(part).max() if resolution else 0.0)
        extreme = constant and part[0] in (least, most)
        how = "stops at its limit of" if extreme else "is stuck at"
        what = f"{how} {part[0] + 0.0:.4g}" if constant else "is a straight line"
        yield Oddity(f"{what} for {(end - begin) / fs:g} s", begin / fs, end / fs)
    if not len(lines):
        yield from _repeated(x, fs, resolution)


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
    length = np.diff(derivatives.true_runs(line), axis=1)
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


def _flat(x: Row, least: float) -> NDArray[np.intp]:
    """Return the stretches in which second differences stay within `least`, shape (number of them, 2)."""
    found = derivatives.chunked_true_runs(np.abs(_bends(x)(piece)) <= least for piece in pieces(x.size - 2))
    return np.asarray(found[found[:, 1] - found[:, 0] >= STRAIGHT - 2] + [0, 2], dtype=np.intp)


def _repeated(x: Row, fs: float, resolution: Resolution | None) -> Iterator[Oddity]:
    edge = int(SETTLED * fs)
    at, same, expected = pieces(x.size - 2 * edge, overlap=1), [], 0.0
    for start, part in ((edge + piece.start, x[edge + piece.start : edge + piece.stop]) for piece in at):
        equal = part[1:] == part[:-1]
        if resolution is not None:
            chance = _chance(part, resolution)
            equal &= chance < CHANCE
            expected += MORE * float(np.sum(chance[chance < CHANCE]))
        same.append(start + np.flatnonzero(equal) + 1)
    again = np.concatenate([np.zeros(0, dtype=np.intp), *same])
    if not again.size:
        return
    if scipy.special.pdtrc(again.size - 1, expected if resolution else _coincidences(x[:])) > COINCIDENCE:
        return
    zero = x[:][again] == 0
    for which, what in ((again[zero], "is exactly 0"), (again[~zero], "repeats a sample")):
        if which.size:
            often = f" {which.size} times, first" * (which.size > 1)
            yield Oddity(f"{what}{often}", which[0] / fs, which[-1] / fs, again=True)


def _chance(x: Array, resolution: Resolution) -> Array:
    """Return the probability that samples are equal to the next one, from how much x moves nearby."""
    increments = np.abs(np.diff(x)) / resolution.at(x[1:])
    moves = scipy.ndimage.uniform_filter1d(np.nan_to_num(increments), NEARBY, mode="nearest")
    return np.where(np.isnan(increments), 1.0, chance_of_equality(moves))


def _coincidences(x: Array) -> float:
    """Return how many neighbours to expect to be equal by chance, from the digits that values have."""
    values, increments = x[np.isfinite(x)], np.abs(np.diff(x))
    most = values[np.argmax(np.abs(values))]
    looked = values[: LOOKED : LOOKED // 200]
    digits = next((d for d in range(5, 16) if all(float(f"{v:.{d}e}") == v for v in looked)), 16)
    digit = 10.0 ** (np.floor(np.log10(abs(most))) - digits)
    near = float(np.nanquantile(increments[increments > 0], NEAR))
    return float(increments.size * NEAR * digit / (2 * near))


def jumps(x: Row, fs: float, step: float = 0.0) -> Iterator[Oddity]:
    """Yield the largest jump or wild sample of a read-out, if noise does not explain it, nor a force.

    Parameters
    ----------
    x : Row
        The read-out.
    fs : float
        Its sample rate [Hz].
    step : float
        To which it is rounded: a few are no jump.
    """
    filled, half = x, max(5, round(1.5 * fs))
    lost, masked = np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
    if any(np.isnan(x[piece]).any() for piece in pieces(x.size)):
        lost = np.isnan(x[:])
        filled, masked = derivatives.interpolate_gaps(x[:], fs)
    if _largest(_bends(filled), x.size - 2, SUSPECT, STEPS * step) is None:
        return
    left, bad = _left(half), lost | masked
    reached = np.convolve(bad, np.ones(2 * half + 1), mode="valid") > 0.5 if bad.any() else None
    for name, limit in (("jumps by", JUMP), ("is off by", WILD)):
        size = _sizes(filled, left[name] / (left[name] @ left[name]), reached)
        at = _largest(size, x.size - 2 * half, limit, STEPS * step)
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


def _largest(size: _Sizes, n: int, limit: float, least: float) -> int | None:
    """Return where one of `n` sizes is farthest beyond what noise does about it.

    None if that is within the limit, in standard deviations, or it is below `least`.
    """
    if n < BLOCK:
        return None
    farthest, at = limit, None
    for start in range(0, n, TOGETHER):
        x = size(slice(start, min(start + TOGETHER, n)))
        if lacking := -x.size % BLOCK:  # at the end: there the last ones come again, backwards
            x = np.concatenate([x, size(slice(n - 1 - lacking, n - 1))[::-1]])
        blocks = np.abs(x).reshape(-1, BLOCK)
        # about zero, as a cubic has been taken off; every fifth tells as much
        noise = np.maximum(_GAUSSIAN * np.median(blocks[:, ::5], axis=1), max(least / limit, 1e-300))
        most = blocks.max(axis=1) / noise
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
    fed = {name for name in commands if noise is not None and is_fed(noise.row(name))}
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


def is_fed(x: Row) -> bool:
    """Tell whether a loop feeds a command: it changes all the time, if only by the steps of its numbers."""
    if is_noisy(x):
        return True
    found = estimate_resolution(x)
    if found is None:
        return False
    part = x[:LOOKED]
    moves = np.abs(np.diff(part)) / found.at(part[1:])
    return bool(np.count_nonzero(moves > 0) > FEWEST * part.size and np.median(moves[moves > 0]) < MANY)


def _of(run: Telemetry, fed: Container[str], name: str) -> list[Oddity]:
    found: list[Oddity] = []
    if name in READ_OUTS or name in fed:
        x = run.row(name)
        if name in fed and authority.limited(run, name).size:
            # is masked, and no fault of the archive
            x = np.where(authority.at_limit(x[:], authority.limit_of(run, name)), np.nan, x[:])
        resolution = estimate_resolution(x)
        found += stuck(x, run.fs, resolution)
        if name in READ_OUTS:
            found += jumps(x, run.fs, resolution.largest if resolution else 0.0)
    return found
