"""Samples of one channel that no instrument gives: constant, on a straight line, or apart from all others.

All of it shows in the channel alone, at the rate of its archive, by its first and second differences. A body
does not jump: a read-out that does is at fault whatever the forces. Commands are constant where no loop feeds
them back, and may jump.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fit.false_alarms import p_limit
from fit.quality import saturation
from fit.quality.initial_fit import initial_fit, lstsq_coefficients
from fit.spectra import NoiseModel, derivatives
from fit.telemetry import CHANNELS, Telemetry
from fit.warnings import Cause
from fit.whitening import Run, whitened_run

Array = NDArray[np.float64]

HEAD = 20000  # samples whose differences show noise and resolution
MIN_FLAT = 8  # differences in a row that are zero: a stretch
NEARBY = 2000  # samples about a stretch that show how often noise and rounding make a difference zero
MAX_SHARE = 0.01  # of differences that are zero, beyond those that rounding makes
MAX_CHANCE = 0.1  # share of these, from which nothing is said
QUIET = 5.0  # times that share of a run, in its quiet parts
WINDOW = 31  # second differences that show the noise around one
LIMIT = 30.0  # their medians, from which a second difference is apart: noise and motion make up to 15
FLOOR = 0.1  # of the median of all second differences: least noise
MIN_VALUES = 16  # that show a step
PARTS = (1, 2, 4, 8, 10, 20)  # of the least difference, that a step of floating point or of decimals may be
MULTIPLE, LATTICE = 0.05, 0.99  # of a step, within which a difference is a multiple, and share that is
COARSE = 0.01  # of the typical difference of neighbours, from which rounding is tried
MAX_SHIFT = 5.0  # sigma, of all estimates of a run together
MAX_STEPS = 4.0  # of rounding, up to which nothing is apart
MAX_WIDTH = 2.6  # samples of a jump: an anti-alias filter makes up to 2.3, a loop that follows its guidance 3
MIN_NOISE = 0.5  # of fifth over fourth differences: noise has 1.5, a sine 2 pi f / fs
MAX_ROUNDING = 64  # spacings of double precision in a fifth difference, with margin: rounding makes 5
#: Warning in place of exclusions if most of the experiments have a fault, by its kind.
CODES = {"interpolation": "interpolated"}


def is_noisy(x: Array) -> bool:
    """Return whether a channel changes nearly always, as noise makes it."""
    return int(np.count_nonzero(x[1:] == x[:-1])) < 0.5 * (x.size - 1)


def sample_faults(run: Telemetry, name: str, x: Array, n_channels: int = 1) -> Iterator[Cause]:
    """Yield where a channel that should be noise is constant or on a straight line.

    A channel of a simulation without noise may be: it rests until an injection begins.

    Parameters
    ----------
    run : Telemetry
        The run.
    name : str
        Of the channel.
    x : ndarray, shape (N,)
        Its samples, nan where they do not count.
    n_channels : int
        Channels of the campaign, which share the budget of false alarms.
    """

    def cause(kind: str, words: str, size: float | None = None, unit: str = "1") -> Cause:
        return Cause(run.run, name, kind, size, None, unit, f"{name} {words}", str(run.path))

    if np.nanmin(x) == np.nanmax(x):
        yield cause("stuck", f"is constant throughout, at {x[~np.isnan(x)][0]:.4g}")
        return
    # that rounding makes a difference zero, at most
    chance = resolution(x) / max(min(_typical(x, order) for order in (1, 2)), 1e-300)
    flat = _flat(x)
    if chance > MAX_CHANCE or not _has_noise(x, flat):
        return
    stretches = _flat_stretches(flat, p_limit("straight lines", n_channels * x.size))
    authority = saturation.limits(run).get(name, 0.0)
    extremes = [value for value in (np.nanmin(x), np.nanmax(x)) if abs(value) < authority]
    stops = [(end - begin, begin) for begin, end in stretches if x[(begin + end) // 2] in extremes]
    if stops:
        length, begin = max(stops)
        seconds, limit = length / run.fs, abs(x[begin + length // 2])
        words = (
            f"stops at its limit of {limit:.3g} {CHANNELS[name].unit} for {seconds:g} s at "
            f"{begin / run.fs:.7g} s, below its authority {saturation.limit_text(name, authority)}; state "
            f"the true limit as F_max_{name[-1]}, then these samples are masked"
        )
        yield cause("limit", words, seconds, "s")
    for begin, end in stretches if not stops else ():
        seconds = (end - begin) / run.fs
        shape = "constant" if x[begin] == x[end - 1] else "a straight line"
        yield cause("stuck", f"is {shape} for {seconds:g} s at {begin / run.fs:.7g} s", seconds, "s")
    share = float(np.mean(flat[:HEAD]))
    if not stretches and share > MAX_SHARE + QUIET * chance:
        percent = f"{100 * share:.0f} % of its samples lie on the line between their neighbours"
        yield cause("interpolation", f"is interpolated: {percent}", share)


def _typical(x: Array, order: int) -> float:
    """Return the median size of the differences of some order that are not zero."""
    sizes = np.abs(np.diff(x[:HEAD], order))
    return float(np.median(sizes[sizes > 0])) if np.any(sizes > 0) else 0.0


def _flat(x: Array) -> NDArray[np.bool_]:
    """Return where a channel does not change, or as much as from the sample before, shape (N - 2,)."""
    curvature = np.abs(np.diff(x, 2))
    rounding = 4 * np.spacing(np.nanmax(np.abs(x)))
    tolerance = max(1e-9 * _typical(x, 2), float(rounding))
    return np.asarray((curvature <= tolerance) | (x[1:-1] == x[:-2]))


def _has_noise(x: Array, flat: NDArray[np.bool_]) -> bool:
    """Return whether differences of high order grow where a channel moves, as those of noise do."""
    differences = (np.abs(np.diff(x, order))[~flat[1:][: x.size - order]] for order in (4, 5))
    fourth, fifth = (sizes[np.isfinite(sizes)] for sizes in differences)
    if not fifth.size:
        return True
    rounding = MAX_ROUNDING * float(np.spacing(np.nanmax(np.abs(x))))
    return bool(np.median(fifth) > max(MIN_NOISE * float(np.median(fourth)), rounding))


def _flat_stretches(flat: NDArray[np.bool_], limit: float) -> list[tuple[int, int]]:
    """Return first sample and end of stretches of flat samples, if chance makes each with p < `limit`.

    Where a share p of the samples nearby is flat, n of them are in a row with probability p^n.
    """
    stretches = []
    counts = np.concatenate([[0], np.cumsum(flat)])
    for begin, end in derivatives.true_runs(flat).tolist():
        reach = max(NEARBY, 4 * (end - begin)) // 2
        first, last = max(begin - reach, 0), min(end + reach, flat.size)
        share = float(counts[last] - counts[first]) / (last - first)
        if end - begin >= MIN_FLAT and (end - begin) * np.log(share) < np.log(limit):
            stretches.append((begin, end + 2))
    return stretches


def resolution(x: Array) -> float:
    """Return the step of which differences of the larger values of a channel are multiples, 0 without one."""
    head = x[:HEAD][np.isfinite(x[:HEAD])]
    large = np.unique(head[np.abs(head) >= np.quantile(np.abs(head), 0.99) / 4]) if head.size else head
    values = large if large.size >= MIN_VALUES else np.unique(head)
    if values.size < 2:
        return 0.0
    for part in PARTS:
        step = float(np.diff(values).min()) / part
        multiples = (values - values[0]) / step
        if np.mean(np.abs(multiples - np.round(multiples)) < MULTIPLE) > LATTICE:
            return step
    return 0.0


def rounding_fault(run: Run, noises: Sequence[NoiseModel], names: Sequence[str]) -> Cause | None:
    """Return the channels of a run that are rounded too coarsely for a fit; None if none is.

    Rounding adds noise, which biases coefficients of what it is part of, and is of the signal where a channel
    moves slowly. Both show when the channels are rounded to three times their steps.

    Parameters
    ----------
    run : Run
        The run.
    noises : sequence of NoiseModel
        The PSD of the residual of each equation.
    names : sequence of str
        Channels of its equations.
    """
    telemetry = run.telemetry
    steps = {name: resolution(telemetry.channels[name]) for name in names}
    coarse = {  # twice would round halves, all to one side
        name: 3 * step * np.round(x / (3 * step))
        for name, step in steps.items()
        if step > COARSE * _typical(x := telemetry.channels[name], 1)
    }
    if not coarse:
        return None
    tau = initial_fit(run).tau
    rounded = Run(replace(telemetry, channels={**telemetry.channels, **coarse})).limit_band(run.f_max)
    shifts = []
    for equation, noise in zip(run.equations, noises, strict=True):
        spectra = [equation.spectra(one.spectra(tau)) for one in (run, rounded)]
        U, V = (whitened_run.whiten(terms, noise.expected(terms.f))[0] for terms in spectra)
        shifts.append(np.linalg.norm(U @ (lstsq_coefficients(V) - lstsq_coefficients(U))))
    shift = float(np.linalg.norm(shifts))
    if shift < MAX_SHIFT:
        return None
    words = (
        f"{' and '.join(f'{name} to steps of {steps[name]:.2g}' for name in coarse)}: rounded too coarsely, "
        f"steps three times as large would move estimates by {shift:.2g} sigma"
    )
    return Cause(telemetry.run, " ".join(coarse), "rounding", shift, words=words, file=str(telemetry.path))


def outliers(x: Array) -> tuple[list[tuple[int, int]], list[tuple[int, float]]]:
    """Find samples of a read-out that are apart from those about them.

    Parameters
    ----------
    x : ndarray, shape (N,)
        The read-out, nan where samples are missing.

    Returns
    -------
    spikes : list of tuple
        First sample and end of each stretch of samples that are off.
    jumps : list of tuple
        Sample at which the read-out jumps, and by how much.
    """
    curvature = np.diff(x, 2)
    size = np.abs(curvature)
    n = size.size // WINDOW * WINDOW
    medians = np.median(np.nan_to_num(size[:n], nan=np.inf).reshape(-1, WINDOW), axis=1)
    floor = LIMIT * max(FLOOR * float(np.median(medians)), MAX_STEPS * resolution(x) / LIMIT)
    inside = slice(WINDOW, n - WINDOW)
    candidates = WINDOW + np.flatnonzero(
        size[inside] > np.maximum(LIMIT / 2 * medians, floor).repeat(WINDOW)[inside]
    )
    nearby = sliding_window_view(size, WINDOW)[candidates - WINDOW // 2]
    apart = np.zeros(size.size, dtype=bool)
    apart[candidates] = size[candidates] > LIMIT * np.median(np.nan_to_num(nearby, nan=np.inf), axis=1)
    if not apart.any():
        return [], []
    spikes: list[tuple[int, int]] = []
    jumps: list[tuple[int, float]] = []
    for begin, end in derivatives.true_runs(
        scipy.ndimage.binary_closing(apart, np.ones(5, dtype=bool))
    ).tolist():
        part = np.nan_to_num(curvature[begin - 2 : end + 2])
        if abs(part.sum()) > 0.2 * np.abs(part).max():
            continue  # a kink: an injection begins or ends
        moment = float((np.arange(part.size) - (part.size - 1) / 2) @ part)
        width = abs(moment) / np.abs(part).max()
        if width > MAX_WIDTH:
            continue  # motion: a loop follows its guidance
        if width > 0.5:
            jumps.append(((begin + end) // 2 + 1, -moment))
        else:
            spikes.append((begin, end + 2))
    return spikes, jumps


def check_samples(
    run: Telemetry, read_outs: Sequence[str], noisy: Sequence[str], n_channels: int = 1
) -> Iterator[Cause]:
    """Yield the faults of the samples of a run.

    Parameters
    ----------
    run : Telemetry
        The run.
    read_outs : sequence of str
        Channels that show positions.
    noisy : sequence of str
        Channels that should be noise.
    n_channels : int
        Channels of the campaign, which share the budget of false alarms.
    """
    for name in noisy:
        x = run.channels[name]
        if not np.isnan(x).all():
            yield from sample_faults(run, name, x, n_channels)
    for name in read_outs:
        for sample, size in outliers(run.channels[name])[1][:1]:
            words = f"{name} jumps by {size:.2g} m at {sample / run.fs:.7g} s"
            yield Cause(run.run, name, "jump", size, None, "m", words, str(run.path))
