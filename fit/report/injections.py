"""The injections of a run, as a table: where, when, how large, at which frequencies."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, timedelta

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.tables import Table
from fit.telemetry import Telemetry, utc

Array = NDArray[np.float64]

#: Factor and unit in print, by unit of a channel.
_PRINTED = {"m": (1e9, "nm"), "rad": (1e9, "nrad"), "m s-2": (1e12, "pm s⁻²")}
_GAP = 10.0  # s, of zeros within one injection
_FLOOR, _WEAKEST = 1e-3, 0.05  # of the largest value of a channel, and of the largest tone
_MOST_TONES = 8
_LEAST = 10.0  # of the largest value in the noise run: commands respond to noise, too
_SAMPLES_PER_CYCLE = 20  # that a sine is fitted to


@dataclass(frozen=True)
class Injection:
    """An injection.

    Attributes
    ----------
    begin, end : float
        Since the first sample of the run [s].
    amplitude : float
        Largest value, in the unit of the channel.
    frequencies : tuple of float
        Of its tones [Hz]; none of a ramp.
    """

    begin: float
    end: float
    amplitude: float
    frequencies: tuple[float, ...]


def injections(x: Array, fs: float) -> Iterator[Injection]:
    """Yield the stretches of a channel that is zero between them, shape (N,), sampled at `fs` [Hz]."""
    values = np.nan_to_num(x)
    places = np.flatnonzero(np.abs(values) > _FLOOR * np.abs(values).max(initial=0.0))
    for part in np.split(places, np.flatnonzero(np.diff(places) > _GAP * fs) + 1) if places.size else ():
        stretch = values[part[0] : part[-1] + 1]
        end = (part[-1] + 1) / fs
        yield Injection(part[0] / fs, end, float(np.abs(stretch).max()), _tones(stretch, fs))


def _tones(x: Array, fs: float) -> tuple[float, ...]:
    """Return the frequencies of the strongest tones [Hz]; none of a signal that keeps its sign.

    A parabola through the logarithms of a peak and its neighbours has its maximum at the tone.
    """
    if x.min() >= 0 or x.max() <= 0:
        return ()
    size = scipy.fft.next_fast_len(2 * x.size, real=True)
    power = np.abs(scipy.fft.rfft(x * np.hanning(x.size), size))
    inner = power[1:-1]
    is_peak = (inner > power[:-2]) & (inner >= power[2:]) & (inner > _WEAKEST * power.max())
    peaks = np.flatnonzero(is_peak) + 1
    strongest = np.sort(peaks[np.argsort(-power[peaks])][:_MOST_TONES])
    below, peak, above = np.log(power[strongest + np.array([[-1], [0], [1]])])
    bins = strongest + (below - above) / (2 * (below - 2 * peak + above))
    tones = tuple((bins * fs / size).tolist())
    return (_frequency_of_tone(x, fs, tones[0]),) if len(tones) == 1 else tones


def _frequency_of_tone(x: Array, fs: float, peak: float) -> float:
    """Return the frequency of a sine [Hz], whose `peak` in a spectrum is biased if it has few cycles."""
    every = max(1, int(fs / (_SAMPLES_PER_CYCLE * peak)))
    x, fs = x[::every], fs / every
    t = np.arange(x.size) / fs

    def unexplained(f: float) -> float:
        phase = 2 * np.pi * f * t
        sines = np.column_stack([np.cos(phase), np.sin(phase)])
        return float(np.sum((x - sines @ np.linalg.lstsq(sines, x)[0]) ** 2))

    reach = 0.5 * fs / x.size
    bounds = (peak - reach, peak + reach)
    best = scipy.optimize.minimize_scalar(
        unexplained, bounds=bounds, method="bounded", options={"xatol": 1e-4 * peak}
    )
    return float(best.x)


def table(run: Telemetry, noise: Telemetry | None) -> Table:
    """Return a row for each injection into set points and f_x_1 that the noise run lacks; times are UTC."""
    start, rows = utc(run.t0).astimezone(UTC), []
    for channel in run.channels:
        if not (channel.startswith("guidance_") or channel == "f_x_1"):
            continue
        unit = run.units.get(channel, "")
        factor, unit = _PRINTED.get(unit, (1.0, unit))
        floor = 0.0
        if noise is not None and channel in noise.channels:
            floor = _LEAST * float(np.nanmax(np.abs(noise.channels[channel])))
        for one in injections(run.channels[channel], run.fs):
            if one.amplitude < floor:
                continue
            begin, end = (start + timedelta(seconds=t) for t in (one.begin, one.end))
            amplitude = np.format_float_positional(factor * one.amplitude, 3, fractional=False, trim="-")
            tones = ", ".join(f"{1e3 * f:.3g}" for f in one.frequencies)
            day = "" if end.date() == begin.date() else "%Y-%m-%d "
            times = (f"{begin:%Y-%m-%d %H:%M:%S}", f"{end:{day}%H:%M:%S}")
            rows.append((channel, *times, f"{amplitude}\u00a0{unit}", tones or "ramp"))
    head = ("Injection into", "Start (UTC)", "End", "Amplitude", "Frequency [mHz]")
    return Table(head, tuple(rows), "Injections, as recorded in these channels.")
