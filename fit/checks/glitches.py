"""Glitches: forces on a test mass, or jumps of a read-out, that last seconds to hours, are masked.

In closed loop a force of seconds moves the bodies for hours, but the calibrated Delta g shows the force
itself and nothing else. The residual of a run, windowed and whitened as the fit does it, is filtered with the
shapes that glitches had in flight (arXiv 2205.11938), which gives the signal-to-noise ratio of each at every
instant. What stands out most is masked first, because a glitch spoils coefficients and PSD; then all begins
again, until nothing stands out.

What the search needs of the dynamics it takes from the run itself: the coefficients of the columns, free of
any model of what experiments share, that leave the least residual. Injected sines are subtracted that way
however far the truth is from the flight's.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.campaign import Campaign
from fit.errors import FitError, InputError
from fit.false_alarms import sigma_limit
from fit.findings import Finding
from fit.parallel import parallel_map
from fit.spectra import NoiseModel, Spectra, Spectrum, derivatives, fit_noise, windowing
from fit.statistics import initial_fit, injections, lstsq_coefficients
from fit.whitening import Experiment, Run, whitened_run

Array = NDArray[np.float64]
Spans = list[tuple[float, float]]

TAUS = 2.0 * 10 ** (np.arange(13) / 3)  # s, 2 s to 5.6 h
#: By name, the transform as a function of ``s = 2 pi i f tau``: exp(-t), t exp(-t), (1 - t) exp(-t), exp(t).
SHAPES: Mapping[str, Callable[[Spectrum], Spectrum]] = {
    "one-sided": lambda s: 1 / (1 + s),
    "rounded": lambda s: 1 / (1 + s) ** 2,
    "of two signs": lambda s: s / (1 + s) ** 2,
    "reversed": lambda s: 1 / (1 - s),
}
RESOLVED = 10.0  # s, tau from which shapes differ
MAX_DURATION_FRACTION = 0.25  # of a run, that tau may take: what is longer passes for a drift
MIN_DURATION = 200  # tau, of a run that shows its own noise
MAD = 1.4826  # standard deviation of normal noise over its median deviation
MARGIN, DECAY = 30.0, 4.0  # s before and after a glitch, and tau in which it dies away, that are masked
PER_CYCLE = 4  # instants in a cycle of the highest frequency, at which glitches are looked for
PEAK_SHARE = 0.3  # of the highest ratio: what is lower may be due to what is higher
N_WAVES = 4  # of half a cycle more each, with which a coefficient may drift
MAX_ITERATIONS = 60  # to get from the highest ratio to the threshold, in both runs
MAX_MASKED = 0.6  # of the weight of a run; if masks would take more, it is no matter of glitches


class GlitchResult(NamedTuple):
    """Glitches of both runs of an experiment, and coincidences of those of its sysid run with injections."""

    findings: list[Finding]
    coincidences: injections.Coincidences


def find(campaign: Campaign) -> list[Finding]:
    """Return the glitches of all experiments.

    Where those of an experiment, or of all, lie in the injections more often than chance allows, the equation
    lacks a signal there: nothing is masked in these runs.
    """
    # flscov interpolates masked samples; what the equation lacks would pass for glitches
    if not campaign.settings.glitches or campaign.settings.estimator == "flscov":
        return []
    if any(finding.code == "model_misfit" for finding in campaign.findings):
        return []
    experiments = [
        e
        for e in campaign.usable
        if all(finding.code != "saturated_too_long" for finding in campaign.of_run(e.name))
    ]
    n_tests = len(experiments) + 1

    def search(e: Experiment) -> GlitchResult | Finding:
        try:
            return find_glitches(e, len(experiments))
        except InputError as error:  # too little is left of it
            return Finding("invalid_data", str(error), e.name)

    results = parallel_map(search, experiments, Experiment.samples)
    searches = {e: x for e, x in zip(experiments, results, strict=True) if isinstance(x, GlitchResult)}
    counts = {e.name: x.coincidences for e, x in searches.items()}
    misfits = {
        name: injections.chance_probability([count])
        for name, count in counts.items()
        if injections.is_excessive([count], n_tests)
    }
    rest = {name: count for name, count in counts.items() if name not in misfits}
    if injections.is_excessive([*rest.values()], n_tests):
        p_value = injections.chance_probability([*rest.values()])
        misfits |= {name: p_value for name, count in rest.items() if count.both}
    findings = [result for result in results if isinstance(result, Finding)]
    for e, result in searches.items():
        if e.name in misfits:
            findings.append(_misfit(e, result, misfits[e.name]))
        is_masked = {e.sysid.telemetry.run: e.name not in misfits}
        findings += [finding for finding in result.findings if is_masked.get(finding.run, True)]
    return findings


def _misfit(e: Experiment, result: GlitchResult, p_value: float) -> Finding:
    """Return that the equation lacks a signal at the injections."""
    count, run = result.coincidences, e.sysid.telemetry.run
    message = (
        f"{run}: the equation of motion lacks a signal at the injections: of "
        f"{count.glitches} stretches with an excess {count.both} are injected, {count.expected:.2g} expected "
        f"by chance (p = {p_value:.1g}); nothing is masked"
    )
    return Finding("model_misfit", message, run)


def find_glitches(experiment: Experiment, n_experiments: int = 1) -> GlitchResult:
    """Return the glitches of an experiment.

    A run that would lose more than `MAX_MASKED` to masks is left as it was, and so is one in which the search
    does not come to an end. It ends early where what it finds lies in the injections.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    n_experiments : int
        Number of experiments in the campaign, which share the budget of false alarms.

    Raises
    ------
    InputError
        If missing samples leave too little of a run.
    """
    cleaned, findings, counts = experiment, list[Finding](), []
    for index in range(len(experiment.sysid.equations)):
        initial = initial_fit(cleaned.sysid)
        runs = [run for run in (cleaned.noise, cleaned.sysid) if run]  # the noise weighs: it goes first
        *noises, sysid = searches = [GlitchSearch(run, initial.tau, 2 * n_experiments, index) for run in runs]
        noise = noises[0] if noises else None
        for iteration in range(MAX_ITERATIONS):
            sysid.update_noise(None if iteration else initial.c[index])
            if noise:
                noise.update_noise(sysid.coefficients_of(noise.columns))
            if not any(search.iterate(noise) for search in searches):
                break
            if sysid.spans and injections.is_excessive([sysid.coincidences], n_experiments + 1):
                break
        else:
            for search in searches:
                search.give_up()
        cleaned = replace(cleaned, sysid=sysid.run, noise=noise.run if noise else None)
        findings += [search.finding() for search in searches if search.spans]
        counts.append(sysid.coincidences)
    return GlitchResult(findings, max(counts, key=lambda count: count.both))


class GlitchSearch:
    """The search for glitches in one run.

    Parameters
    ----------
    run : Run
        As it is.
    tau : tuple of float
        Delays [s] about which its columns are expanded.
    n_runs : int
        Number of runs of the campaign that are searched.
    index : int
        Number of the equation.

    Attributes
    ----------
    run : Run
        Without what has been found so far.
    spans : list of tuple of float
        Begin and end [s] of what is found.
    columns : tuple of str
        Names of the columns of the equation.
    """

    def __init__(self, run: Run, tau: tuple[float, float], n_runs: int, index: int = 0) -> None:
        self.run, self._original, self._tau, self._n_runs = run, run, tau, n_runs
        self.spans: Spans = []
        self._has_too_many = False
        self._equation = run.equations[index]
        self.columns = self._equation.columns
        self._model: NoiseModel | None = None
        self._power: tuple[Array, Array, Array] | None = None
        self._injected: NDArray[np.bool_] | None = None

    def update_noise(self, c: Array | None) -> None:
        """Take the coefficients of the columns, shape (P,), or fit them, and what they leave for noise."""
        terms = self._equation.spectra(self.run.spectra(self._tau))
        S = self._psd(terms.f)
        self._c = lstsq_coefficients(whitened_run.whiten(terms, S)[0]) if c is None else c
        z, dof = whitened_run.whiten(terms.summed(self._c), S)
        self._power = terms.f, np.abs(z[:, 0]) ** 2 * S / 2, np.maximum(dof, 0)

    def coefficients_of(self, columns: Sequence[str]) -> Array:
        """Return those of another run, which may carry read-outs of spacecraft motion that this one lacks."""
        coefficients = dict(zip(self.columns, self._c.tolist(), strict=True))
        return np.array([coefficients.get(name, 0.0) for name in columns])

    @property
    def coincidences(self) -> injections.Coincidences:
        """Glitches and injections of the run."""
        if self.spans and self._injected is None:
            self._injected = injections.injected_cells(self._original, self._tau)
        return injections.coincidences(self._original, self.spans, self._injected)

    def _psd(self, f: Array) -> Array:
        """Return the PSD of what is left, shape (B,), at first the shape it had in flight."""
        if self._power:  # most are never asked for, as the noise run decides
            with suppress(FitError):  # where glitches spoil the residual that much, the PSD before has to do
                self._model = fit_noise(*self._power)
            self._power = None
        return self._model.expected(f) if self._model else self.run.spacecraft.level(f)

    def iterate(self, noise: "GlitchSearch | None") -> bool:
        """Mask the strongest glitches; return False if there are none."""
        if self._has_too_many or not (spans := self._strongest(noise)):
            return False
        self.spans = merge_spans([*self.spans, *spans])
        self.run = self._original.mask(self.spans)
        if self.run.weight < (1 - MAX_MASKED) * self._original.weight:
            self.give_up()
        return True

    def give_up(self) -> None:
        """Mask nothing."""
        self.run, self._has_too_many = self._original, bool(self.spans)

    def _strongest(self, noise: "GlitchSearch | None") -> Spans:
        """Return where the shape that stands out most does, nothing if none does."""
        terms = self._equation.spectra(self.run.spectra(self._tau))
        S = (noise or self)._psd(terms.f)
        least = 0.0 if noise in (self, None) else 1.0  # of the noise: that of the noise run
        fs, start = self.run.channels.fs, float(self.run.channels.time[derivatives.HALF])
        residual = whitened_run.whiten(terms, S)[0] @ self._c
        peaks = strongest_peaks(terms, residual, S, fs, least, self._n_runs)
        if peaks and noise is not self:
            U = whitened_run.whiten(terms.hstack(self._drifting(terms)), S)[0]
            peaks = strongest_peaks(terms, U @ lstsq_coefficients(U), S, fs, least, self._n_runs)
        spans = (peak.span for peak in peaks)
        return [(start + begin - MARGIN, start + end + MARGIN) for begin, end in spans]

    def _drifting(self, terms: Spectra) -> Spectra:
        """Return the columns, but the first, times waves: what drifts within a run is no glitch."""
        columns = self.run.columns(self._tau)
        cycle = np.linspace(0, np.pi, len(columns.values))[:, None]
        waves = [np.cos(n * cycle) for n in range(1, N_WAVES + 1)]
        products = [self.run.transformed(columns.values * wave, columns) for wave in waves]
        spectra = [self._equation.spectra(part).columns[:, 1:] for part in products]
        return replace(terms, columns=np.concatenate(spectra, axis=1))

    def finding(self) -> Finding:
        """Return what is found."""
        name = self.run.telemetry.run
        if self._has_too_many:
            message = (
                f"{name}: more exceeds the noise than glitches explain: masks would remove more than "
                f"{100 * MAX_MASKED:g} % of the run, or take more than {MAX_ITERATIONS} steps; "
                "nothing is masked"
            )
            return Finding("too_many_glitches", message, name)
        message = f"{name}: {describe_spans(self.spans, 'masked')}"
        return Finding("glitches", message, name, spans=tuple(self.spans))


class Glitch(NamedTuple):
    """One of the `SHAPES`, its time scale tau [s], and when it begins, or ends if it is reversed [s]."""

    shape: str
    tau: float
    time: float

    @property
    def span(self) -> tuple[float, float]:
        """Begin and end [s] of where it is notable."""
        reach = DECAY * self.tau
        return (self.time - reach, self.time) if self.shape == "reversed" else (self.time, self.time + reach)


def strongest_peaks(
    terms: Spectra, residual: Spectrum, S: Array, fs: float, least: float = 0.0, n_runs: int = 1
) -> list[Glitch]:
    """Return where the matched filter that is farthest over its threshold has peaks, the highest first.

    Parameters
    ----------
    terms : Spectra
        The run.
    residual : ndarray of complex, shape (B,)
        Whitened.
    S : ndarray, shape (B,)
        PSD of its noise.
    fs : float
        Sample rate of the run [Hz].
    least : float
        Least standard deviation of the output.
    n_runs : int
        Number of runs of the campaign that are searched.
    """
    n = terms.window.size
    m = min(scipy.fft.next_fast_len(PER_CYCLE * (terms.first + terms.f.size), real=True), n)
    visible = np.interp(np.arange(m) * n / m, np.arange(n), terms.window) > 0.5
    if not visible.any():
        return []
    scale = m / 2 * np.sqrt(np.mean(terms.window**2))
    largest, glitches = 1.0, []
    for tau in TAUS[MAX_DURATION_FRACTION * n / fs > TAUS].tolist():
        limit = sigma_limit(round(n_runs * len(SHAPES) * 4 * n / fs / tau))
        floor = least if n / fs > MIN_DURATION * tau else 1.0  # too few are independent for a median
        for name, transform in SHAPES.items() if tau >= RESOLVED else [*SHAPES.items()][:1]:
            template = np.conj(transform(2j * np.pi * terms.f * tau)) / np.sqrt(S)
            template *= scale / np.linalg.norm(template)
            output = np.abs(windowing.inverse_transform((residual * template)[:, None], terms.first, m)[:, 0])
            ratio = output / max(MAD * float(np.median(output[visible])), floor, 1e-300) / limit
            if ratio.max() > largest:
                largest = float(ratio.max())
                peaks = derivatives.true_runs(ratio > max(1.0, PEAK_SHARE * largest))
                highest = [begin + int(np.argmax(ratio[begin:end])) for begin, end in peaks]
                highest.sort(key=lambda i: -ratio[i])
                glitches = [Glitch(name, tau, i * n / m / fs) for i in highest]
    return glitches


def describe_spans(spans: Sequence[tuple[float, float]], treatment: str, what: str = "glitch") -> str:
    """Return how many glitches there are, what was done with them, and where."""
    places = ", ".join(f"{a:.0f} s ({b - a:.0f} s)" for a, b in spans)
    plural = ("es" if what.endswith("h") else "s") * (len(spans) > 1)
    return f"{len(spans)} {what}{plural} {treatment}, at {places}"


def merge_spans(spans: Sequence[tuple[float, float]]) -> Spans:
    """Join spans that overlap."""
    merged: Spans = []
    for begin, end in sorted(spans):
        if merged and begin <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(end, merged[-1][1])
        else:
            merged.append((begin, end))
    return merged
