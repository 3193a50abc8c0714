"""What may be wrong with all of a run: hypotheses, each a remedy and its words.

Channels of another scale, sign or unit, late, smoothed, exchanged, those of another run, in reverse. What
grows along the run or with the force. What is no matter of a channel: a sine, a slow drift, and stretches in
which something else acts. An amount is the one that leaves least.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.consistency.trial import BLOCK, Remedy, Trial, of_bins
from fit.model import dynamics
from fit.parameters import M_TM
from fit.spectra import derivatives
from fit.warnings import Cause
from fit.whitening import Experiment

Array = NDArray[np.float64]
Channels = Mapping[str, Array]

LAGS = 300.0  # s, up to which a channel may be late
PADDED = 4  # lags that are tried to every sample
WHOLE = 0.03  # of a sample: so near to a number of samples a lag is that number
SURE = 5.0  # sigma
ROUND = 0.01  # by which a unit or a sign may be off
AMOUNT = 2.0  # by which chi2 must fall for an amount, as information criteria have it
SOUGHT = 8.0  # and more for a place: among some hundreds
MOST_LEFT_OUT = 0.2  # of a run, that stretches may take
SLOWEST = 4  # periods in a run, without which a sine is no more than a drift
BENT = [2, 3, 4]  # degrees of a slow drift; an offset and a slope do no harm
REACH = 30.0  # s, that are left out on either side
TOLD = 4  # stretches at most that are named
LOUD = 1e-9  # p-value of the power of a block from which something else acts there
TAPS = (-2, -1, 1, 2)  # samples, of a filter that undoes another
FILTERED = 0.05  # Hz, where it is told what a filter does
PREFIXES = {1e3: "m", 1e6: "u", 1e9: "n", 1e12: "p"}


@dataclass(frozen=True)
class Hypothesis:
    """What may be wrong with a run, and what would mend it.

    Attributes
    ----------
    cause : Cause
        Channel, kind, size; without the name of the run.
    remedy : Remedy
        What mends it.
    costs : float
        What it must lower chi2 by to be as likely as nothing.
    """

    cause: Cause
    remedy: Remedy
    costs: float


def of_all(trial: Trial, others: Sequence[Experiment]) -> Iterator[Hypothesis]:
    """Yield the hypotheses about all of a run; `others` may have lent it their channels."""
    x = {name: getattr(trial.sysid.channels, name) for name in dynamics.CHANNELS}
    live = [name for name in dynamics.CHANNELS if np.ptp(x[name]) > 0]
    for name in live:
        yield from _scales(trial, name, x[name])
        yield from _lags(trial, name, x[name])
        yield from _filters(trial, name, x[name])
    yield from _exchanges(trial, x, others)
    yield from _growing(trial, {name: x[name] for name in live})
    yield _line(trial)
    yield _drift(trial)
    yield from _stretches(trial)


def amount(trial: Trial, name: str, change: Array) -> tuple[float, float, float]:
    """Return how much of a change of a channel there is, its sigma, and by how much chi2 falls."""
    gain, amounts, sigmas = trial.gain(trial.column(name, change)[:, None])
    return float(amounts[0]), float(sigmas[0]), gain


def _scales(trial: Trial, name: str, x: Array) -> Iterator[Hypothesis]:
    """Try another scale; what is near a sign or a unit is one."""
    a, sigma, _ = amount(trial, name, x)
    if 1 + a == 0:
        return
    factor, of_factor = 1 / (1 + a), sigma / (1 + a) ** 2
    cause, exact = factor_cause(name, factor, of_factor)
    of_o_12 = exact if name == "o_12" else 1.0
    yield Hypothesis(cause, Remedy({name: x / exact}, factor=of_o_12), AMOUNT)


def factor_cause(name: str, factor: float, sigma: float) -> tuple[Cause, float]:
    """Return the cause that a factor on a channel is, and the factor as it must be exactly."""

    def cause(kind: str, words: str) -> Cause:
        return Cause("", name, kind, factor, sigma, "1", words)

    near = max(ROUND, SURE * sigma / abs(factor))
    if abs(factor + 1) < near:
        return cause("sign", f"{name} has the wrong sign"), -1.0
    unit = "m s-2" if name.startswith("f") else "m"
    for size, prefix in PREFIXES.items():
        for real, short in ((size, f"{prefix}{unit}"), (1 / size, f"10^{round(np.log10(size))} {unit}")):
            if abs(factor / real - 1) < near:
                return cause("unit", f"{name} is in {short} and not in {unit}"), real
    if name.startswith("f") and abs(factor / M_TM - 1) < near:
        return cause("unit", f"{name} is in N and not in m s-2"), M_TM
    words = f"{name} is {factor:.6g} ± {sigma:.1g} times what it should be"
    return cause("scale", words), factor


def moved(x: Array, fs: float, late: float) -> Array:
    """Return a channel that was late by so much [s] as it should be; the ends are held."""
    samples = round(late * fs)
    n = np.clip(np.arange(x.size) + samples, 0, x.size - 1)
    rest = late - samples / fs
    if abs(rest) * fs < 1e-9:
        return x[n]
    padded = np.pad(x[n], derivatives.HALF, mode="edge")
    return derivatives.derivative(padded, fs, 0, -rest)


def _lags(trial: Trial, name: str, x: Array) -> Iterator[Hypothesis]:
    """Try that a channel is late or early, and that it is of another scale as well."""
    fs, seen = trial.sysid.channels.fs, trial.as_it_is
    column = trial.column(name, x)
    u = of_bins(column)
    r = seen.U @ seen.c - column
    product = of_bins(r).conj() * u
    n = PADDED * seen.found.window.size
    padded = np.zeros(n // 2 + 1, dtype=np.complex128)
    padded[seen.found.first : seen.found.first + u.size] = product
    both = scipy.fft.irfft(padded, n) * n / 2  # <rest, u moved by tau>
    tau = scipy.fft.fftfreq(n, 1 / n) / (fs * PADDED)
    inside = np.abs(tau) < min(LAGS, 0.05 * seen.found.window.size / fs)
    for scaled in (False, True):
        target = -(both**2) if scaled else both
        late = float(tau[inside][np.argmin(target[inside])])
        g = -float(both[inside][np.argmin(target[inside])]) / float(np.vdot(u, u).real) if scaled else 1.0
        yield from _lag(trial, name, x, late, g, scaled=scaled)


def _lag(trial: Trial, name: str, x: Array, late: float, g: float, *, scaled: bool) -> Iterator[Hypothesis]:
    """Refine a lag, and a scale if there is to be one."""
    fs, sigma, of_scale = trial.sysid.channels.fs, np.inf, 0.0
    for _ in range(3):
        y = g * moved(x, fs, late)
        slope = np.gradient(y) * fs
        changes = [slope, y] if scaled else [slope]
        once, *E = (trial.column(name, d) for d in (y - x, *changes))
        _, amounts, sigmas = trial.gain(np.column_stack(E), once)
        late, sigma = late + float(amounts[0]), float(sigmas[0])
        if scaled:
            g, of_scale = g * (1 + float(amounts[1])), float(sigmas[1])
    whole = round(late * fs)
    is_whole = whole != 0 and abs(late * fs - whole) < max(WHOLE, SURE * sigma * fs)
    late = whole / fs if is_whole else late
    if abs(late) < SURE * sigma or (scaled and abs(g - 1) < SURE * of_scale):
        return
    by = f"{abs(whole)} sample{'s' * (abs(whole) > 1)}" if is_whole else f"{abs(late):.3g} ± {sigma:.1g} s"
    words, costs = f"{name} is {'late' if late > 0 else 'early'} by {by}", AMOUNT + SOUGHT * (whole != 0)
    remedy = Remedy({name: g * moved(x, fs, late)}, factor=1 / g if name == "o_12" else 1.0)
    if scaled:
        scale = factor_cause(name, 1 / g, of_scale / g**2)[0].words
        cause = Cause("", name, "lag and scale", late, sigma, "s", f"{words}, and {scale}")
        yield Hypothesis(cause, remedy, costs + AMOUNT)
    else:
        yield Hypothesis(Cause("", name, "lag", late, sigma, "s", words), remedy, costs)


def _filters(trial: Trial, name: str, x: Array) -> Iterator[Hypothesis]:
    """Try that a channel has gone through a filter of its own, which a few taps undo."""
    fs = trial.sysid.channels.fs
    moves = np.stack([moved(x, fs, n / fs) - x for n in TAPS], axis=1)
    columns = np.column_stack([trial.column(name, move) for move in moves.T])
    b, inverse = trial.reduced(columns)

    def undone(y: Array, f: Array) -> NDArray[np.complex128]:
        turns = np.exp(2j * np.pi * f[:, None] / fs * np.array(TAPS)) - 1
        return np.asarray(1 + turns @ (inverse @ y))

    def spread(y: Array) -> float:
        """Return by how much chi2 is too large only because a filter has made noise louder."""
        return -4 * float(np.sum(np.log(np.abs(undone(y, trial.as_it_is.found.f)))))

    def left(y: Array) -> float:
        return float((b + y) @ (b + y)) + spread(y)

    y, of_noise = -b, 0.0
    if name == "o_12":  # the noise of the residual is its own
        y = scipy.optimize.minimize(left, y).x
        of_noise = spread(y)
    passed = complex(1 / undone(y, np.array([FILTERED]))[0])
    late = -np.angle(passed) / (2 * np.pi * FILTERED)
    words = (
        f"{name} has gone through a filter of its own, which at {1e3 * FILTERED:g} mHz passes "
        f"{abs(passed):.3g} of it, {abs(late):.2g} s {'late' if late > 0 else 'early'}"
    )
    costs = len(TAPS) * AMOUNT + SOUGHT + of_noise  # no less than the lag that it contains
    cause = Cause("", name, "filter", float(late), None, "s", words)
    yield Hypothesis(cause, Remedy({name: x + moves @ (inverse @ y)}), costs)


def _exchanges(trial: Trial, x: Channels, others: Sequence[Experiment]) -> Iterator[Hypothesis]:
    """Try other channels in the place of one, of this run or of another, and all of them in reverse."""
    for first, second in (("o_1", "o_12"), ("f_x_1", "f_x_2")):
        remedy = Remedy({first: x[second], second: x[first]})
        words = f"{first} and {second} are exchanged"
        yield Hypothesis(Cause("", f"{first} {second}", "exchange", words=words), remedy, 0.0)
    reverse = Cause("", "", "reverse", words="samples are in reverse order")
    yield Hypothesis(reverse, Remedy({k: v[::-1] for k, v in x.items()}), 0.0)
    for e in others:
        run = e.sysid.channels
        if e.sysid.telemetry.run == trial.run.run or run.fs != trial.sysid.channels.fs:
            continue
        for name in dynamics.CHANNELS:
            lent = getattr(run, name)
            if lent.size == x[name].size and np.ptp(lent) > 0:
                words = f"{name} is not its own: that of {e.sysid.telemetry.run} fits"
                cause = Cause("", name, "exchange", words=words)
                yield Hypothesis(cause, Remedy({name: lent}), AMOUNT + SOUGHT)


def _growing(trial: Trial, x: Channels) -> Iterator[Hypothesis]:
    """Try that scale, lag, stiffness or leakage drifts, and that the gain depends on the force."""
    time, fs = trial.sysid.channels.time, trial.sysid.channels.fs
    share = (time - time.mean()) / np.ptp(time)
    for name, of in x.items():
        both = np.column_stack([trial.column(name, change) for change in (of, of * share)])
        _, (whole, a), (_, sigma) = trial.gain(both)
        more = "a growing" if a < 0 else "a falling"
        words = f"{name} has {more} scale, by {100 * abs(a):.2g} ± {100 * sigma:.1g} % from start to end"
        cause = Cause("", name, "scale that drifts", float(-a), float(sigma), "1", words)
        yield Hypothesis(cause, Remedy({name: of * (1 + whole + a * share)}), 2 * AMOUNT)
        slope = np.gradient(of) * fs
        both = np.column_stack([trial.column(name, change) for change in (slope, slope * share)])
        _, (whole, a), (_, sigma) = trial.gain(both)
        ever = "later" if a > 0 else "earlier"
        words = f"{name} is ever {ever}, by {abs(a):.2g} ± {sigma:.1g} s from start to end"
        cause = Cause("", name, "lag that drifts", float(a), float(sigma), "s", words)
        yield Hypothesis(cause, Remedy({name: of + (whole + a * share) * slope}), 2 * AMOUNT)
        if name.startswith("f"):
            largest = float(np.abs(of).max())
            for bent, what in (
                (of**2, "the sign and size of the force"),
                (of * np.abs(of), "the size of the force"),
            ):
                a, sigma, _ = amount(trial, name, bent / largest)
                words = (
                    f"gain lambda_{name[-1]} changes with {what}, by {100 * abs(a):.2g} ± "
                    f"{100 * sigma:.1g} % at {largest:.2g} m s-2"
                )
                cause = Cause("", name, "gain by force", a, sigma, "1", words)
                yield Hypothesis(cause, Remedy({name: of + a * bent / largest}), AMOUNT)
    inner = trial.as_it_is.terms
    names = dict(zip(inner.names, inner.values.T, strict=True))
    drift = (inner.time - time.mean()) / np.ptp(time)
    for what, unit, at in (
        ("omega2_2", " s-2", names["o_12"] + names["o_1"]),
        ("omega2_1", " s-2", -names["o_1"]),
        ("delta_ifo", "", -names["ddo_1"]),
    ):
        series = np.column_stack([at, at * drift])
        _, amounts, sigmas = trial.gain(trial.whitened(series))
        words = f"{what} changes by {amounts[1]:.2g} ± {sigmas[1]:.1g}{unit} from start to end"
        cause = Cause("", what, "drift", float(amounts[1]), float(sigmas[1]), unit.strip() or "1", words)
        yield Hypothesis(cause, Remedy(acceleration=-series @ amounts), 2 * AMOUNT)


def _line(trial: Trial) -> Hypothesis:
    """Try a sine of one frequency that no channel holds."""
    seen = trial.as_it_is
    time, bin_width = seen.terms.time, float(seen.found.f[1] - seen.found.f[0])
    power = np.abs(seen.residual) ** 2
    f = float(seen.found.f[np.argmax(np.where(seen.found.f < SLOWEST * bin_width, 0.0, power))])

    def at(f: float) -> tuple[float, Array]:
        pair = np.stack([np.cos(2 * np.pi * f * time), np.sin(2 * np.pi * f * time)], axis=1)
        gain, amounts, _ = trial.gain(trial.whitened(pair))
        return gain, np.asarray(-pair @ amounts)

    for step in (0.25, 0.05, 0.01):
        f = max((f + step * k * bin_width for k in range(-4, 5)), key=lambda g: at(g)[0])
    series = at(f)[1]
    size = float(np.sqrt(2 * np.mean(series**2)))
    words = f"Delta g holds a sine of {1e3 * f:.4g} mHz and {size:.2g} m s-2"
    return Hypothesis(
        Cause("", "", "line", size, None, "m s-2", words), Remedy(acceleration=series), 3 * AMOUNT + SOUGHT
    )


def _drift(trial: Trial) -> Hypothesis:
    """Try a slow drift that no channel explains: of a read-out, or of a force."""
    time = trial.as_it_is.terms.time
    slow = np.polynomial.legendre.legvander(2 * (time - time[0]) / np.ptp(time) - 1, BENT[-1])[:, BENT]
    _, amounts, _ = trial.gain(trial.whitened(slow))
    drift = np.asarray(slow @ amounts)
    words = f"o_12 or a force holds a slow drift, as if of {np.ptp(drift):.2g} m s-2"
    cause = Cause("", "o_12", "slow drift", float(np.ptp(drift)), None, "m s-2", words)
    return Hypothesis(cause, Remedy(acceleration=-drift), len(BENT) * AMOUNT)


def _stretches(trial: Trial) -> Iterator[Hypothesis]:
    """Leave out stretches in which something else acts, with what lies beside them."""
    seen = trial.as_it_is
    most = float(scipy.special.chdtri(seen.freedom, LOUD)) / seen.freedom
    loud = np.flatnonzero(seen.blocks > most * max(1.0, float(np.median(seen.blocks))))
    if not loud.size or loud.size * BLOCK > MOST_LEFT_OUT * np.ptp(seen.terms.time):
        return
    first = float(seen.terms.time[0]) - REACH
    groups = np.split(loud, np.flatnonzero(np.diff(loud) > 1) + 1)
    spans = tuple((first + BLOCK * g[0], first + BLOCK * (g[-1] + 1) + 2 * REACH) for g in groups)
    told = ", ".join(f"{begin:.0f} to {end:.0f} s" for begin, end in spans[:TOLD])
    often = f" in {len(spans)} stretches, first" if len(spans) > TOLD else ""
    words = f"Delta g holds something else{often} from {told}"
    # what is left out is as many amounts
    yield Hypothesis(Cause("", "", "stretches", words=words), Remedy(without=spans), seen.freedom * loud.size)
