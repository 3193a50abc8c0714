"""Whether the read-outs answer the injections that guidance shows, as those of the other experiments do.

A loop answers its guidance by a transfer that is smooth and the same in all runs: one, at low frequency, and
less above. Its controllers need not be known: the median over three experiments or more, that inject at a
frequency, is what is expected there. The fit takes nothing from guidance; but where it belongs to other data
than the read-outs, the label is wrong or the read-outs are, and what is said of the run may be of another.

A run that answers otherwise is told only where one hypothesis brings it back to what the others do: a scale,
a lag, no answer at all, guidance of another channel or run, an injection that guidance does not show. Another
controller is none of these.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fit.parallel import parallel_map
from fit.spectra import windowing
from fit.telemetry import PIECE, Telemetry, pieces
from fit.warnings import FitWarning
from fit.whitening import Experiment

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

CHANNELS = ("o_1", "o_12")
BANDS = 3e-4 * 2 ** (np.arange(17) / 2)  # Hz, edges
SAMPLE = 2.0  # s, that samples are averaged over
FAINT = 1e-4  # power of a band over that of the strongest, below which it holds no injection
ALIKE = 0.02  # by which the mean frequencies of two injections may differ
FEWEST = 3  # experiments that tell what is expected
CLEAR = 0.95  # coherence of read-out and guidance there
OTHERWISE = 0.25  # distance of an answer, over the one expected, from 1; authority and stiffness make 0.05
SAME = 0.12  # that a hypothesis leaves at most
LAGS = 300.0  # s, up to which they are tried


@dataclass(frozen=True)
class Seen:
    """What one run was asked and answered.

    Attributes
    ----------
    path : str
        Of its file.
    f : ndarray, shape (B,)
        Frequencies [Hz].
    asked, answered : mapping of str to ndarray, shape (B,)
        Transforms of guidance and read-outs, by channel.
    """

    path: str
    f: Array
    asked: Mapping[str, Complex]
    answered: Mapping[str, Complex]

    @cached_property
    def bands(self) -> list[slice]:
        """The bins of every band."""
        at = np.searchsorted(self.f, BANDS)
        return [slice(a, b) for a, b in pairwise(at)]

    def injected(self, channel: str) -> Array:
        """Return the mean frequency [Hz] of the injection in every band, 0 where none is, shape (B,)."""
        power = np.abs(self.asked[channel]) ** 2
        total = np.array([power[band].sum() for band in self.bands])
        mean = np.array([power[band] @ self.f[band] for band in self.bands])
        return np.asarray(np.where(total > FAINT * total.max(), mean / np.maximum(total, 1e-300), 0.0))

    def answers(self, channel: str, asked: Complex) -> tuple[Complex, Array]:
        """Return by how much the read-out answers in every band, and its coherence, each of shape (B,)."""
        read, found = self.answered[channel], []
        for band in self.bands:
            G, o = asked[band], read[band]
            both, power, answered = np.vdot(G, o), np.vdot(G, G).real, np.vdot(o, o).real
            told = power > 0 and answered > 0
            found.append((both / power, abs(both) ** 2 / power / answered) if told else (0.0, 0.0))
        R, coherence = np.array(found).T
        return R, coherence.real


@dataclass(frozen=True)
class _Expected:
    """What read-outs answer, by channel and frequency, of so many runs."""

    f: Array
    R: Complex
    clear: NDArray[np.bool_]

    def at(self, f: Array) -> Complex:
        """Return the median answer to injections at these frequencies [Hz], nan where few tell it."""
        found = np.full(f.size, np.nan, dtype=complex)
        for i in np.flatnonzero(f):
            alike = np.abs(self.f / f[i] - 1) < ALIKE
            if (
                np.count_nonzero(alike & self.clear) >= FEWEST
                and 2 * (alike & self.clear).sum() > alike.sum()
            ):
                R = self.R[alike & self.clear]
                found[i] = np.median(R.real) + 1j * np.median(R.imag)
        return found


def seen(experiments: Sequence[Experiment]) -> dict[str, Seen]:
    """Return what the experiments that show guidance were asked and answered, by name."""
    runs = {e.name: e.sysid.telemetry for e in experiments if _shows(e.sysid.telemetry)}
    return dict(zip(runs, parallel_map(_seen, list(runs.values())), strict=True))


def odd(seen: Mapping[str, Seen]) -> list[FitWarning]:
    """Return what is said of experiments whose read-outs and guidance do not belong together."""
    if len(seen) < FEWEST:
        return []
    expected = {channel: _expected(list(seen.values()), channel) for channel in CHANNELS}
    found = []
    for name in seen:
        said = [why for channel in CHANNELS if (why := _hypothesis(name, channel, seen, expected))]
        if said:
            found.append(f"{seen[name].path}: {' and '.join(said)}")
    if 2 * len(found) > len(seen):
        return []  # no majority that tells what is right
    return [FitWarning("guidance_response", (), why) for why in found]


def _shows(run: Telemetry) -> bool:
    names = {*CHANNELS, *(f"guidance_{channel}" for channel in CHANNELS)}
    return names <= run.channels.keys() and run.size > 2 / BANDS[0] * run.fs


def _seen(run: Telemetry) -> Seen:
    """Transform guidance and read-outs of a run, averaged to few samples."""
    n = max(1, round(SAMPLE * run.fs))
    names = [f"{of}{channel}" for of in ("guidance_", "") for channel in CHANNELS]
    series, lost = _means(run, names, n, np.zeros(run.size // n * n, dtype=bool))
    if lost.any():  # what one channel misses is left out of all
        series, _ = _means(run, names, n, lost)
    found = windowing.transform(series - series.mean(axis=0), np.ones(len(series), dtype=bool), run.fs / n)
    keep = np.flatnonzero(found.f < BANDS[-1])
    columns = dict(zip(names, found.columns[keep].T, strict=True))
    return Seen(
        str(run.path),
        found.f[keep],
        {channel: columns[f"guidance_{channel}"] for channel in CHANNELS},
        {channel: columns[channel] for channel in CHANNELS},
    )


def _means(
    run: Telemetry, names: Sequence[str], n: int, lost: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the means of channels over n samples each without those that are lost, and which are then."""
    means = []
    for name in names:
        row, of_row = run.row(name), np.empty(lost.size // n)
        for piece in pieces(lost.size, length=PIECE // n * n):
            x = row[piece]
            of_row[piece.start // n : piece.stop // n] = (
                np.where(lost[piece], 0.0, x).reshape(-1, n).mean(axis=1)
            )
            lost[piece] |= ~np.isfinite(x)
        means.append(of_row)
    return np.stack(means, axis=1), lost


def _expected(seen: Sequence[Seen], channel: str) -> _Expected:
    f, R, coherence = [], [], []
    for run in seen:
        own = run.injected(channel)
        answer, clear = run.answers(channel, run.asked[channel])
        f.append(own[own > 0])
        R.append(answer[own > 0])
        coherence.append(clear[own > 0])
    return _Expected(np.concatenate(f), np.concatenate(R), np.concatenate(coherence) > CLEAR)


def _hypothesis(name: str, channel: str, seen: Mapping[str, Seen], expected: Mapping[str, _Expected]) -> str:
    """Return what brings a channel of a run back to what those of the others do; empty if nothing need."""
    own = seen[name]
    f = own.injected(channel)
    usual = expected[channel].at(f)
    tells = np.isfinite(usual)
    R, _ = own.answers(channel, own.asked[channel])
    ratio = (R[tells] / usual[tells]) if tells.any() else np.zeros(0, dtype=complex)
    if ratio.size and np.abs(ratio - 1).max() > OTHERWISE:
        if changed := _changed(channel, f[tells], ratio):
            return changed
        for other, asked in _others(name, channel, seen):
            if _fits(own, channel, asked, expected[channel]):
                return f"{channel} answers {other}, not guidance_{channel} of its own"
        return f"{channel} does not answer guidance_{channel}" if np.all(np.abs(ratio) < SAME) else ""
    return _unshown(name, channel, seen, expected[channel], f)


def _others(name: str, channel: str, seen: Mapping[str, Seen]) -> Iterator[tuple[str, Complex]]:
    """Yield guidance that a run may have been given instead, in words and as a transform."""
    own = seen[name]
    for other in CHANNELS:
        if other != channel:
            yield f"guidance_{other}", own.asked[other]
    for run, what in seen.items():
        if run != name and what.f.size == own.f.size:
            yield f"guidance_{channel} of {run}", what.asked[channel]


def _fits(own: Seen, channel: str, asked: Complex, expected: _Expected) -> bool:
    """Return whether a read-out answers other guidance as the read-outs of others answer theirs."""
    given = replace(own, asked={channel: asked})
    usual = expected.at(given.injected(channel))
    tells = np.isfinite(usual)
    R, coherence = given.answers(channel, asked)
    if np.count_nonzero(tells) < 2:
        return False
    return bool(np.all(np.abs(R[tells] / usual[tells] - 1) < SAME) and np.all(coherence[tells] > CLEAR))


def _changed(channel: str, f: Array, ratio: Complex) -> str:
    """Return whether a scale or a lag explains answers, over those expected, at `f` [Hz]."""
    asked, scale = f"guidance_{channel}", float(ratio.real.mean())
    if np.all(np.abs(ratio - scale) < SAME * abs(scale)):
        return f"{channel} answers {asked} by {scale:.2g} times as much as in the other experiments"
    lags = np.arange(-LAGS, LAGS, 1 / (40 * f.max()))
    apart = np.abs(ratio[:, None] - np.exp(-2j * np.pi * f[:, None] * lags)).max(axis=0)
    lag = float(lags[np.argmin(apart)])
    if f.size > 1 and apart.min() < SAME:
        return f"{channel} answers {asked} about {abs(lag):.2g} s too {'late' if lag > 0 else 'early'}"
    return ""


def _unshown(name: str, channel: str, seen: Mapping[str, Seen], expected: _Expected, f: Array) -> str:
    """Return which injections a read-out answers as others do, though guidance does not show them."""
    own = seen[name]
    for other, asked in _others(name, channel, seen):
        given = replace(own, asked={channel: asked})
        more = given.injected(channel)
        usual = expected.at(np.where(f > 0, 0.0, more))
        tells = np.isfinite(usual)
        R, coherence = given.answers(channel, asked)
        same = tells & (coherence > CLEAR)
        same[tells] &= np.abs(R[tells] / usual[tells] - 1) < SAME
        if same.any():
            low, high = 1e3 * more[same].min(), 1e3 * more[same].max()
            at = f"between {low:.2g} and {high:.2g}" if np.count_nonzero(same) > 1 else f"at {low:.2g}"
            return f"{channel} answers injections {at} mHz, as in {other}, that its guidance does not show"
    return ""
