"""Corrections of a run: what may be wrong with it, and how it would read if that were undone.

Every candidate has its cost in chi^2: 2 for each amount (Akaike), and 2 log n for what is the best of n lags,
instants or frequencies.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.consistency import scans
from fit.consistency.fault_templates import RUN_TEMPLATES
from fit.consistency.run_test import BLOCK, MAX_LEVEL_CHANGE, Correction, RunTest
from fit.consistency.score_test import ScoreTestResult
from fit.consistency.template_effects import late_by_second
from fit.false_alarms import p_limit
from fit.model import dynamics
from fit.parameters import M_TM
from fit.spectra import derivatives
from fit.units import concise_value
from fit.warnings import Cause
from fit.whitening import Experiment

Array = NDArray[np.float64]

AMOUNT = 2.0  # cost of an amount
PLACE = 2 * np.log(300.0)  # of a place among some hundreds
SIGNIFICANT = 5.0  # sigma, from which an amount differs from zero
WHOLE_SAMPLE = 0.03  # of a sample, up to which a lag is a number of samples
EXACT_SCALE = 0.01  # relative, up to which a scale is a unit or a sign
MAX_MASKED = 0.2  # share of a run
MASK_MARGIN = 30.0  # s on either side of a masked segment
MAX_SEGMENTS = 4  # that are listed
DRIFT_DEGREES = (2, 3, 4)  # of a slow drift; an offset and a slope do no harm
TAPS = (-2, -1, 1, 2)  # samples, of a filter that inverts another
FILTER_FREQUENCY = 0.05  # Hz, at which a filter is described
LOST_SAMPLES = (1, -1)  # of the file, that may be lost or come twice
EDGE = 2.0  # s about the end of a shifted segment, that are masked
MIN_GAIN = 0.5  # of that of the best segment, from which another is refined
MAX_REFINED = 4
PREFIXES = {1e3: "m", 1e6: "u", 1e9: "n", 1e12: "p"}


@dataclass(frozen=True)
class Candidate:
    """What may be wrong with a run.

    Attributes
    ----------
    cause : Cause
        Without the name of the run.
    correction : Correction
        What undoes it.
    cost : float
        By how much chi^2 must fall for it to be as likely as no fault.
    """

    cause: Cause
    correction: Correction
    cost: float


def whole_run_candidates(test: RunTest, lenders: Sequence[Experiment]) -> Iterator[Candidate]:
    """Yield what may be wrong with all of a run; `lenders` are runs whose channels it may contain."""
    x = {name: test.experiment.sysid.channels.series[name] for name in dynamics.CHANNELS}
    for name in _live(x):
        yield from _scale(test, name, x[name])
        yield from _lags(test, name, x[name])
        yield from _filter(test, name, x[name])
    yield from _templates(test)
    yield from _labels(test)
    yield from _exchanges(test, x, lenders)
    yield _sine(test)
    yield _slow_drift(test)
    yield from _loud_segments(test)


def segment_candidates(test: RunTest, min_gain: float) -> Iterator[Candidate]:
    """Yield what may be wrong with a part of a run and lowers chi^2 by `min_gain` or more."""
    x = {name: test.experiment.sysid.channels.series[name] for name in dynamics.CHANNELS}
    fs, time = test.experiment.sysid.channels.fs, test.series.columns.time
    segments = []
    for name in _live(x):
        changes: dict[int | None, Array] = {n: x[name] - shifted(x[name], fs, n / fs) for n in LOST_SAMPLES}
        changes |= {None: late_by_second(test.series, x[name]), 0: x[name]}
        for n, change in changes.items():
            column = test.channel_effects(name, change[:, None])[: len(test.recorded.U), 0]
            segment = scans.scan_segment(
                column, test.recorded.residual, test.recorded.spectra, time, fixed=bool(n)
            )
            segments.append((segment, name, n, change))
    segments.sort(key=lambda item: -item[0].delta_chi2)
    for segment, name, n, change in segments[:MAX_REFINED]:
        if segment.edges and segment.delta_chi2 > max(MIN_GAIN * segments[0][0].delta_chi2, min_gain):
            yield _segment(test, segment, name, x[name], n, change)
    for name in _live(x):
        yield _jump(test, name, x[name])


def shifted(x: Array, fs: float, lag: float) -> Array:
    """Return a channel that was late by a lag [s] as it should be; its ends are continued."""
    samples = round(lag * fs)
    n = np.clip(np.arange(x.size) + samples, 0, x.size - 1)
    remainder = lag - samples / fs
    if abs(remainder) * fs < 1e-9:
        return x[n]
    padded = np.pad(x[n], derivatives.HALF, mode="edge")
    return derivatives.derivative(padded, fs, 0, -remainder)


def scale_cause(channel: str, factor: float, sigma: float) -> tuple[Cause, float]:
    """Return the cause that a scale of a channel is, and the factor, exact for a unit or a sign."""

    def cause(kind: str, words: str) -> Cause:
        return Cause("", channel, kind, factor, sigma, "1", words)

    tolerance = max(EXACT_SCALE, SIGNIFICANT * sigma / abs(factor))
    if abs(factor + 1) < tolerance:
        return cause("sign", f"{channel} has the wrong sign"), -1.0
    unit = "m s-2" if channel.startswith("f") else "m"
    for size, prefix in PREFIXES.items():
        for scale, name in ((size, f"{prefix}{unit}"), (1 / size, f"10^{round(np.log10(size))} {unit}")):
            if abs(factor / scale - 1) < tolerance:
                return cause("unit", f"{channel} is in {name} and not in {unit}"), scale
    if channel.startswith("f") and abs(factor / M_TM - 1) < tolerance:
        return cause("unit", f"{channel} is in N and not in m s-2"), M_TM
    return cause("scale", f"{channel} is {concise_value(factor, sigma)} times its correct value"), factor


def _live(x: Mapping[str, Array]) -> list[str]:
    return [name for name, series in x.items() if np.ptp(series) > 0]


def _channel_test(test: RunTest, name: str, changes: Array) -> ScoreTestResult:
    """Return the amounts of changes, shape (N, E), that a channel contains."""
    return test.recorded.test.test(test.channel_effects(name, changes))


def _templates(test: RunTest) -> Iterator[Candidate]:
    """Yield the templates of `RUN_TEMPLATES` whose amount is significant."""
    for template in RUN_TEMPLATES:
        effects = [effect(test.series) for effect in (template.effect, template.nuisance) if effect]
        series = [effect for effect in effects if effect is not None]
        if len(series) < len(effects):
            continue
        columns = np.stack(series, axis=1)
        result = test.recorded.test.test(test.whitened(columns))
        amount, sigma = float(result.amounts[0]), float(result.sigmas[0])
        if abs(amount) < SIGNIFICANT * sigma or not template.admits(amount, sigma):
            continue
        force = test.series.largest_force[int(template.channel[-1]) - 1] if "force" in template.kind else 0.0
        cause = template.cause(amount, sigma, force=force)
        yield Candidate(cause, Correction(acceleration=columns @ result.amounts), AMOUNT * len(effects))


def _scale(test: RunTest, name: str, x: Array) -> Iterator[Candidate]:
    """Try another scale of a channel."""
    result = _channel_test(test, name, x[:, None])
    a, sigma = float(result.amounts[0]), float(result.sigmas[0])  # share of the channel that should not be
    if a == 1 or abs(a) < SIGNIFICANT * sigma:
        return
    cause, factor = scale_cause(name, 1 / (1 - a), sigma / (1 - a) ** 2)
    correction = Correction({name: x / factor}, o_12_scale=factor if name == "o_12" else 1.0)
    yield Candidate(cause, correction, AMOUNT)


def _lags(test: RunTest, name: str, x: Array) -> Iterator[Candidate]:
    """Try that a channel is late or early, and that its scale is wrong as well."""
    recorded, fs = test.recorded, test.experiment.sysid.channels.fs
    column = test.channel_effects(name, x[:, None])[: len(recorded.U), 0]
    remainder = recorded.U @ recorded.coefficients - column
    for scaled in (False, True):
        lag, scale = scans.scan_lag(column, remainder, recorded.spectra, fs, scaled=scaled)
        yield from _lag(test, name, x, lag, scale, scaled=scaled)


def _lag(
    test: RunTest, name: str, x: Array, lag: float, scale: float, *, scaled: bool
) -> Iterator[Candidate]:
    """Refine a lag, and a scale if that is free, by Gauss-Newton steps."""
    fs, sigma, scale_sigma = test.experiment.sysid.channels.fs, np.inf, 0.0
    for _ in range(3):
        y = scale * shifted(x, fs, lag)
        changes = np.stack([x - y, late_by_second(test.series, y), y][: 3 if scaled else 2], axis=1)
        columns = test.channel_effects(name, changes)
        result = test.recorded.test.test(columns[:, 1:], columns[:, 0])
        lag, sigma = lag + float(result.amounts[0]), float(result.sigmas[0])
        if scaled:
            scale, scale_sigma = scale * (1 - float(result.amounts[1])), float(result.sigmas[1])
    samples = round(lag * fs)
    is_whole = samples != 0 and abs(lag * fs - samples) < max(WHOLE_SAMPLE, SIGNIFICANT * sigma * fs)
    lag = samples / fs if is_whole else lag
    if abs(lag) < SIGNIFICANT * sigma or (scaled and abs(scale - 1) < SIGNIFICANT * scale_sigma):
        return
    text = (
        f"{abs(samples)} sample{'s' * (abs(samples) > 1)}"
        if is_whole
        else f"{concise_value(abs(lag), sigma)} s"
    )
    words = f"{name} is {'late' if lag > 0 else 'early'} by {text}"
    cost = AMOUNT * (1 + scaled) + PLACE * (samples != 0)
    correction = Correction(
        {name: scale * shifted(x, fs, lag)}, o_12_scale=1 / scale if name == "o_12" else 1.0
    )
    kind = "lag and scale" if scaled else "lag"
    if scaled:
        words = f"{words}, and {scale_cause(name, 1 / scale, scale_sigma / scale**2)[0].words}"
    yield Candidate(Cause("", name, kind, lag, sigma, "s", words), correction, cost)


def _filter(test: RunTest, name: str, x: Array) -> Iterator[Candidate]:
    """Try that a channel has passed a filter of its own, which a few taps invert."""
    fs = test.experiment.sysid.channels.fs
    changes = np.stack([shifted(x, fs, n / fs) - x for n in TAPS], axis=1)
    columns = test.recorded.test.independent(test.channel_effects(name, changes))
    Q, R = np.linalg.qr(columns)
    inverse, b = np.linalg.pinv(R, rcond=1e-8), Q.T @ test.recorded.test.residual

    def response(y: Array, f: Array) -> NDArray[np.complex128]:
        shifts = np.exp(2j * np.pi * f[:, None] / fs * np.array(TAPS)) - 1
        return np.asarray(1 + shifts @ (inverse @ y))

    def noise_gain(y: Array) -> float:
        """Return by how much chi^2 rises only because a filter amplifies the noise."""
        return -4 * float(np.sum(np.log(np.abs(response(y, test.recorded.spectra.f)))))

    def chi2(y: Array) -> float:
        return float((b + y) @ (b + y)) + noise_gain(y)

    y, noise_cost = -b, 0.0
    if name == "o_12":  # whose noise is that of the residual
        y = scipy.optimize.minimize(chi2, y, method="L-BFGS-B").x
        noise_cost = noise_gain(y)
    gain = complex(1 / response(y, np.array([FILTER_FREQUENCY]))[0])
    lag = float(-np.angle(gain) / (2 * np.pi * FILTER_FREQUENCY))
    words = (
        f"{name} was filtered unlike the other channels: at {1e3 * FILTER_FREQUENCY:g} mHz by the factor "
        f"{abs(gain):.3g}, and {abs(lag):.2g} s {'late' if lag > 0 else 'early'}"
    )
    cost = len(TAPS) * AMOUNT + PLACE + noise_cost  # no less than the lag that it contains
    correction = Correction({name: x + changes @ (inverse @ y)})
    yield Candidate(Cause("", name, "filter", lag, None, "s", words), correction, cost)


def _labels(test: RunTest) -> Iterator[Candidate]:
    """Try other authorities and alignment epochs."""
    run = test.telemetry
    for a, b, channel in (
        ("F_max_1", "F_max_2", "F_max_1 F_max_2"),
        ("N_max_1", "N_max_2", "N_max_1 N_max_2"),
    ):
        values = getattr(run, a), getattr(run, b)
        if values[0] != values[1]:
            labels = replace(run, **{a: values[1], b: values[0]})
            cause = Cause("", channel, "exchange", words=f"{a} and {b} are exchanged")
            yield Candidate(cause, Correction(labels=labels), 0.0)
    for epoch in sorted(test.epochs - {run.alignment_epoch}):
        words = f"its alignment epoch is {epoch} and not {run.alignment_epoch}"
        labels = replace(run, alignment_epoch=epoch)
        yield Candidate(
            Cause("", "alignment_epoch", "label", epoch, words=words), Correction(labels=labels), AMOUNT
        )


def _exchanges(test: RunTest, x: Mapping[str, Array], lenders: Sequence[Experiment]) -> Iterator[Candidate]:
    """Try other channels in the place of one, of this run or of another, and all of them in reverse order."""
    for a, b in (("o_1", "o_12"), ("f_x_1", "f_x_2")):
        cause = Cause("", f"{a} {b}", "exchange", words=f"{a} and {b} are exchanged")
        yield Candidate(cause, Correction({a: x[b], b: x[a]}), 0.0)
    cause = Cause("", "", "reverse", words="samples are in reverse order")
    yield Candidate(cause, Correction({name: series[::-1] for name, series in x.items()}), 0.0)
    for e in lenders:
        run = e.sysid.channels
        if e.name == test.experiment.name or run.fs != test.experiment.sysid.channels.fs:
            continue
        for name in dynamics.CHANNELS:
            series = run.series[name]
            if series.size == x[name].size and np.ptp(series) > 0:
                words = f"{name} belongs to another run: that of {e.sysid.telemetry.run} fits"
                cause = Cause("", name, "exchange", words=words)
                yield Candidate(cause, Correction({name: series}), AMOUNT + PLACE)


def _sine(test: RunTest) -> Candidate:
    """Try a sine of one frequency that no channel contains."""
    time = test.series.columns.time

    def fit(f: float) -> tuple[ScoreTestResult, Array]:
        pair = np.stack([np.cos(2 * np.pi * f * time), np.sin(2 * np.pi * f * time)], axis=1)
        return test.recorded.test.test(test.whitened(pair)), pair

    f = scans.scan_frequency(test.recorded.residual, test.recorded.spectra, lambda f: fit(f)[0].delta_chi2)
    result, pair = fit(f)
    size = float(np.hypot(*result.amounts))
    words = f"Delta g contains a sine of {1e3 * f:.4g} mHz and {size:.2g} m s-2"
    cause = Cause("", "", "line", size, None, "m s-2", words)
    return Candidate(cause, Correction(acceleration=pair @ result.amounts), 3 * AMOUNT + PLACE)


def _slow_drift(test: RunTest) -> Candidate:
    """Try a slow drift that no channel explains: of a read-out, or of a force."""
    time = test.series.columns.time
    share = 2 * (time - time[0]) / np.ptp(time) - 1
    columns = np.polynomial.legendre.legvander(share, DRIFT_DEGREES[-1])[:, DRIFT_DEGREES]
    drift = columns @ test.recorded.test.test(test.whitened(columns)).amounts
    size = float(np.ptp(drift))
    words = f"o_12 or a force contains a slow drift of {size:.2g} m s-2"
    cause = Cause("", "o_12", "slow drift", size, None, "m s-2", words)
    return Candidate(cause, Correction(acceleration=drift), len(DRIFT_DEGREES) * AMOUNT)


def _loud_segments(test: RunTest) -> Iterator[Candidate]:
    """Mask segments in which something else acts."""
    recorded = test.recorded
    limit = float(scipy.special.chdtri(recorded.block_dof, p_limit("runs", recorded.block_powers.size)))
    level = max(1.0, float(np.median(recorded.block_powers)))
    excess_blocks = np.flatnonzero(recorded.block_powers > limit / recorded.block_dof * level)
    if not excess_blocks.size or excess_blocks.size * BLOCK > MAX_MASKED * np.ptp(recorded.columns.time):
        return
    start = float(recorded.columns.time[0]) - MASK_MARGIN
    groups = np.split(excess_blocks, np.flatnonzero(np.diff(excess_blocks) > 1) + 1)
    spans = tuple((start + BLOCK * g[0], start + BLOCK * (g[-1] + 1) + 2 * MASK_MARGIN) for g in groups)
    listed = ", ".join(f"{begin:.0f} to {end:.0f} s" for begin, end in spans[:MAX_SEGMENTS])
    count = f" in {len(spans)} segments, first" if len(spans) > MAX_SEGMENTS else ""
    words = f"Delta g contains an unknown force{count} from {listed}"
    # every masked datum is as good as an amount
    yield Candidate(
        Cause("", "", "segments", words=words),
        Correction(masked=spans),
        recorded.block_dof * excess_blocks.size,
    )


def _segment(
    test: RunTest, segment: scans.Segment, name: str, x: Array, n: int | None, change: Array
) -> Candidate:
    """Refine a segment in which a channel is late by n samples, by any time (None), or of other scale (0)."""
    channels = test.experiment.sysid.channels

    def fit(segment: scans.Segment) -> ScoreTestResult:
        part = np.where(segment.contains(channels.time), change, 0.0)
        return _channel_test(test, name, part[:, None])

    def delta_chi2(segment: scans.Segment) -> float:
        result = fit(segment)
        if not n:
            return result.delta_chi2
        information = float(result.sigmas[0]) ** -2
        return information * (2 * float(result.amounts[0]) - 1)  # of an effect of amount one

    segment = scans.refine_segment(segment, delta_chi2)
    result = fit(segment)
    amount, sigma = float(result.amounts[0]), float(result.sigmas[0])
    contained = segment.contains(channels.time)
    corrected, cost = x, AMOUNT + PLACE * len(segment.edges)
    masked: tuple[tuple[float, float], ...] = ()
    if n == 0 and abs(amount - 1) < 2 * EXACT_SCALE:
        cause, corrected = Cause("", name, "excess", words=f"{name} contains invalid data"), 0 * x
    elif n == 0:
        cause, factor = scale_cause(name, 1 / (1 - amount), sigma / (1 - amount) ** 2)
        corrected = x / factor
        if (
            name == "o_12" and 1 / MAX_LEVEL_CHANGE < abs(factor) < MAX_LEVEL_CHANGE
        ):  # the noise is scaled along
            n_data = 2 * test.recorded.S.size * float(np.mean(contained))
            cost += 2 * n_data * float(np.log(abs(factor)))
    else:
        lag, error = (n / channels.fs, None) if n else (amount, sigma)
        text = f"{abs(n)} sample" if n else f"{concise_value(abs(lag), sigma)} s"
        words = f"{name} is {'late' if lag > 0 else 'early'} by {text}"
        cause = Cause("", name, "lag", lag, error, "s", words)
        corrected = shifted(x, channels.fs, float(np.clip(lag, -5 / channels.fs, 5 / channels.fs)))
        # there a sample is lost or comes twice
        masked = tuple((edge - EDGE, edge + EDGE) for edge in segment.edges) if n else ()
    cause = replace(cause, kind=f"{cause.kind} of a part", words=f"{cause.words} {segment.words}")
    return Candidate(cause, Correction({name: np.where(contained, corrected, x)}, masked=masked), cost)


def _jump(test: RunTest, name: str, x: Array) -> Candidate:
    """Try a step of a channel where it would stand out most."""
    recorded, time = test.recorded, test.experiment.sysid.channels.time

    def step(begin: float) -> Array:
        return np.asarray(time >= begin, dtype=np.float64)

    middle = float(recorded.columns.time[recorded.spectra.window.size // 2])
    column = test.channel_effects(name, step(middle)[:, None])[: len(recorded.U), 0]
    onset = scans.scan_onset(column, recorded.residual, recorded.spectra, recorded.columns.time)
    begins = onset + np.arange(-3, 4) / recorded.columns.fs
    results = [_channel_test(test, name, step(begin)[:, None]) for begin in begins]
    i = int(np.argmax([result.delta_chi2 for result in results]))
    size, sigma = float(results[i].amounts[0]), float(results[i].sigmas[0])
    unit = "m s-2" if name.startswith("f") else "m"
    words = f"{name} jumps by {abs(size):.2g} {unit} at {begins[i]:.0f} s"
    cause = Cause("", name, "jump", size, sigma, unit, words)
    return Candidate(cause, Correction({name: x - size * step(begins[i])}), AMOUNT + PLACE)
