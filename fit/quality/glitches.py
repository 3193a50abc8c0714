"""Glitches: forces on a test mass, or jumps of a read-out, that last seconds to hours.

In closed loop a force of seconds moves the bodies for hours, but the calibrated Delta g shows the force
itself and nothing else. The search is that for known shapes in coloured noise. The residual of a run,
windowed and whitened as the fit does it, is filtered with bell curves of some widths and with the longer
shapes of `matching_pursuit`, which gives the signal-to-noise ratio of a glitch at every instant.

A short glitch is masked: its own samples go, whatever its shape. Patches take them out as long as these are
few; where they are long or many, the window has notches. To mask a long one would cost hours, so that its
shape becomes a column of the run with an amplitude of its own, projected out of everything like constant and
ramp. What a shape leaves of it is found by the next round. In the end begin and times are free as well.

What the search needs of the dynamics it takes from the run itself: the coefficients of the columns, free of
any model of what experiments share, that leave the least residual. Injected sines are subtracted that way
however far the truth is from the flight's. What stands out most is dealt with first, because a glitch spoils
coefficients and PSD; then all begins again, until nothing new stands out.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.quality.initial_fit import initial_fit, lstsq_coefficients
from fit.quality.injections import Coincidences, coincidences, injected_cells, is_excessive
from fit.quality.matched_filter import WIDTHS, MatchedFilter
from fit.quality.matching_pursuit import matching_pursuit
from fit.quality.whitened_templates import WhitenedTemplates
from fit.spectra import NoiseModel, Spectrum, derivatives, fit_noise
from fit.warnings import FitWarning, TimeSpan
from fit.whitening import Experiment, Glitch, Run, whitened_run

Array = NDArray[np.float64]

REACH = 2.2  # widths on either side of a glitch that are masked along
MIN_REACH = 2.0  # s, the same; the stencils add some 10 s, as they do to missing samples
PEAK_SHARE = 0.3  # of the highest ratio: what is lower may be due to what is higher
MAX_ITERATIONS = 60  # to get from the highest ratio to the threshold, in both runs
SHAPE_MARGIN = 1.2  # a mask goes with any shape, so that one must be that much clearer than a bell curve
RAISED_SIGMA = 0.5  # noise of the narrowest bell curve, relative to the PSD, that a short glitch has raised
MAX_MASKED = 0.6  # of the weight of a run; if masks would take more, it is no matter of glitches
MAX_SEGMENT = 60.0  # s; a patch that is longer may hide the onset of a long glitch, which is then not found
MAX_IMPULSES = 100  # that patches are made of; with more, all masks are cut out of the window
MAX_SHAPES = 40  # that are taken out of a run; beyond, the same
FITTED_ALONG = "fitted and subtracted"
TOO_MANY = "too_many_glitches"  # code of the warning where nothing was masked


@dataclass(frozen=True)
class GlitchResult:
    """What a search for glitches has found in an experiment.

    Attributes
    ----------
    searched : Experiment
        The runs as they were.
    experiment : Experiment
        The runs with short glitches masked and long ones fitted along.
    warnings : tuple of tuple
        Name of a run, and the warning that it has glitches, or too many.
    coincidences : Coincidences
        Glitches and injections of the sysid run.
    """

    searched: Experiment
    experiment: Experiment
    warnings: tuple[tuple[str, FitWarning], ...]
    coincidences: Coincidences

    def discard_sysid(self) -> "GlitchResult":
        """Return the result without what was found in the sysid run."""
        sysid = self.searched.sysid
        warnings = tuple((name, w) for name, w in self.warnings if name != sysid.telemetry.run)
        return replace(self, experiment=replace(self.experiment, sysid=sysid), warnings=warnings)


def remove_glitches(experiment: Experiment, n_experiments: int = 1) -> GlitchResult:
    """Mask the short glitches of an experiment and fit the shapes of the long ones along.

    A run that would lose more than `MAX_MASKED` to masks, or need more than `MAX_SHAPES`, is left as it
    was. The search ends early where what it finds lies in the injections.

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
    results = [_search(experiment, 0, n_experiments)]
    for index in range(1, len(experiment.sysid.equations)):
        results.append(_search(results[-1].experiment, index, n_experiments))
    cleaned, counts = results[-1].experiment, [result.coincidences for result in results]
    warnings = tuple(warning for result in results for warning in result.warnings)
    return GlitchResult(experiment, cleaned, warnings, max(counts, key=lambda count: count.both))


def _search(experiment: Experiment, index: int, n_experiments: int) -> GlitchResult:
    """Return what is found in one of the equations of an experiment."""
    initial = initial_fit(experiment.sysid)
    sysid = GlitchSearch(experiment.sysid, initial.tau, 2 * n_experiments, index)
    noise = (
        GlitchSearch(experiment.noise, initial.tau, 2 * n_experiments, index) if experiment.noise else None
    )
    searches = [sysid, noise] if noise else [sysid]
    for iteration in range(MAX_ITERATIONS):
        sysid.update_noise(None if iteration else initial.c[index])
        if noise:
            noise.update_noise(noise.coefficients_of(sysid.coefficients))
        # the noise weighs: it goes first
        if not any(search.iterate(noise) for search in reversed(searches)):
            break
        if sysid.has_glitches and is_excessive([sysid.coincidences], n_experiments + 1):
            break
    cleaned = Experiment(sysid.run.with_free_shapes(), noise.run.with_free_shapes() if noise else None)
    named = [(search.run.telemetry.run, search.warning()) for search in searches if search.has_glitches]
    return GlitchResult(experiment, cleaned, tuple(named), sysid.coincidences)


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
    has_glitches, gave_up : bool
        Whether there are glitches, and whether they were too many.
    """

    def __init__(self, run: Run, tau: tuple[float, float], n_runs: int, index: int = 0) -> None:
        self.run, self._original, self._n_runs = run, run, n_runs
        self.has_glitches = self.gave_up = False
        self._flags = np.zeros_like(run.channels.valid)
        self._shapes: list[Glitch] = []
        self._equation = run.equations[index]
        self._names = self._equation.columns
        self._model: NoiseModel | None = None
        self._power: tuple[Array, Array, Array] | None = None
        self._tau = tau

    def update_noise(self, c: Array | None) -> None:
        """Take the coefficients of the columns, shape (P,), or fit them, and what they leave for noise."""
        terms = self._equation.spectra(self.run.spectra(self._tau))
        S = self._psd(terms.f)
        self._c = lstsq_coefficients(whitened_run.whiten(terms, S)[0]) if c is None else c
        z, dof = whitened_run.whiten(terms.summed(self._c), S)
        self._power = terms.f, np.abs(z[:, 0]) ** 2 * S / 2, np.maximum(dof, 0)

    @property
    def coefficients(self) -> dict[str, float]:
        """Those of the columns, by name."""
        return dict(zip(self._names, self._c.tolist(), strict=True))

    def coefficients_of(self, coefficients: Mapping[str, float]) -> Array:
        """Return those of another run; one may carry read-outs of spacecraft motion that the other lacks."""
        return np.array([coefficients.get(name, 0.0) for name in self._names])

    @property
    def coincidences(self) -> Coincidences:
        """Glitches and injections of the run."""
        masks, shapes = self.run.masks[len(self._original.masks) :], self._shapes
        return coincidences(self._original, masks, shapes, self._injected)

    @cached_property
    def _injected(self) -> NDArray[np.bool_] | None:
        """Which of its cells are injected."""
        return injected_cells(self._original, self._tau) if self.has_glitches else None

    def _psd(self, f: Array) -> Array:
        """Return the PSD of what is left, shape (B,), at first the shape it had in flight."""
        if self._power:  # most are never asked for, as the noise run decides
            with suppress(FitError):  # where glitches spoil the residual that much, the PSD before has to do
                self._model = fit_noise(*self._power)
            self._power = None
        return self._model.expected(f) if self._model else self.run.spacecraft.level(f)

    def iterate(self, noise: "GlitchSearch | None") -> bool:
        """Mask the strongest short glitches or subtract long ones; return False if there are none."""
        if self.gave_up:
            return False
        terms = self._equation.spectra(self.run.spectra(self._tau))
        S = (noise or self)._psd(terms.f)
        U, _ = whitened_run.whiten(terms, S)
        matched = MatchedFilter(terms, U @ self._c, S, 0.0 if noise in (self, None) else 1.0, self._n_runs)
        short_glitch = not matched.below_threshold and matched.maximum > matched.threshold
        # of what is raised at the highest frequencies nothing long is the cause, and it hides what is
        raised = short_glitch and matched.narrowest_sigma < RAISED_SIGMA
        templates = None if raised else self._templates(noise, S, U)
        del U  # it fills the memory, with that of a long run
        long = matching_pursuit(templates) if templates else []
        clear = [
            candidate.glitch
            for candidate in long
            if candidate.snr > SHAPE_MARGIN * self._mask_snr(candidate.glitch, matched)
        ]
        if clear:
            self._shapes += clear
        elif short_glitch:
            self._mask(matched)
        elif long:
            self._shapes += [candidate.glitch for candidate in long]
        else:
            return False
        self.has_glitches = True
        time = self.run.channels.time
        stretches = [(float(time[a]), float(time[b - 1])) for a, b in derivatives.true_runs(self._flags)]
        masked = self._original.mask(stretches)
        self.gave_up = (
            masked.weight < (1 - MAX_MASKED) * self._original.weight or len(self._shapes) > MAX_SHAPES
        )
        if self.gave_up:
            self.run = self._original
        else:
            brief = [(begin, end) for begin, end in stretches if end - begin <= MAX_SEGMENT]
            patched = self._original.mask_by_impulses(brief)
            impulses = patched.impulses(time, self.run.channels.fs)
            if impulses is not None and impulses.size <= MAX_IMPULSES:
                masked = patched.mask([stretch for stretch in stretches if stretch not in brief])
            self.run = masked.with_glitches(self._shapes)
        return True

    def _mask_snr(self, glitch: Glitch, matched: MatchedFilter) -> float:
        """Return what a bell curve finds where a glitch is notable, at most."""
        start, fs, (begin, end) = self.run.channels.time[derivatives.HALF], self.run.channels.fs, glitch.span
        samples = (round((t - start) * fs) for t in (begin - WIDTHS[-1], end + WIDTHS[-1]))
        return matched.largest_output(slice(*(max(sample, 0) for sample in samples)))

    def _mask(self, matched: MatchedFilter) -> None:
        """Flag the samples of the peaks of the matched filters."""
        fs, envelope = self.run.channels.fs, matched.envelope
        runs = derivatives.true_runs(envelope > max(matched.threshold, PEAK_SHARE * float(envelope.max())))
        peaks = [begin + int(np.argmax(envelope[begin:end])) for begin, end in runs]
        for peak, width in zip(peaks, matched.widths(peaks), strict=True):
            reach, middle = int(np.ceil(max(MIN_REACH, REACH * width) * fs)), peak + derivatives.HALF
            self._flags[max(0, middle - reach) : middle + reach + 1] = True
        for begin, end in derivatives.true_runs(~self._flags):
            if begin > 0 and end < self._flags.size and end - begin <= 2 * derivatives.HALF:
                self._flags[begin:end] = True  # the stencils leave nothing of it

    def _templates(self, noise: "GlitchSearch | None", S: Array, U: Spectrum) -> WhitenedTemplates:
        """Return the run as the pursuit sees it, whitened by the PSD S of its noise or of its noise run."""
        terms = self._equation.spectra(self.run.spectra(self._tau))
        transformed = slice(derivatives.HALF, derivatives.HALF + terms.window.size)
        projected = [terms.nuisance * np.sqrt(2 / S)[:, None]]
        if self is not noise:  # the coefficients of a noise run are those of the sysid run
            projected.append(U[:, 1:][:, np.any(U[:, 1:] != 0, axis=0)])
        nuisance = np.asfortranarray(np.concatenate(projected, axis=1))
        nuisance /= np.linalg.norm(nuisance, axis=0)
        Q, residual = (
            whitened_run.orthonormal(whitened_run.as_real(nuisance)),
            whitened_run.as_real(U @ self._c),
        )
        return WhitenedTemplates(
            time=self.run.channels.time[transformed],
            fs=self.run.channels.fs,
            f=terms.f,
            S=S,
            window=terms.window,
            residual=residual - Q @ (Q.T @ residual),
            Q=Q,
            is_own_psd=noise in (self, None),
            known=tuple(self._shapes),
            n_runs=self._n_runs,
        )

    def warning(self) -> FitWarning:
        """Return the warning that describes the glitches."""
        name = self.run.telemetry.run
        if self.gave_up:
            message = (
                f"{name}: masking everything that exceeds the noise would remove more than "
                f"{100 * MAX_MASKED:g} % of the run, or take more than {MAX_SHAPES} shapes, which "
                "glitches do not explain; nothing is masked"
            )
            return FitWarning(TOO_MANY, (), message)
        masks, end = (
            sorted(self.run.masks[len(self._original.masks) :]),
            float(self.run.telemetry.time[-1]),
        )
        subtracted = merge_spans([(max(a, 0.0), min(b, end)) for a, b in (g.span for g in self._shapes)])
        groups = ((masks, "masked"), (subtracted, FITTED_ALONG))
        clauses = [describe_spans(spans, treatment) for spans, treatment in groups if spans]
        spans = tuple(TimeSpan(name, *span) for span in sorted([*masks, *subtracted]))
        return FitWarning("glitches", (), f"{name}: {'; '.join(clauses)}", spans=spans)


def describe_spans(spans: Sequence[tuple[float, float]], treatment: str, what: str = "glitch") -> str:
    """Return how many glitches there are, what was done with them, and where."""
    places = ", ".join(f"{a:.0f} s ({b - a:.0f} s)" for a, b in spans)
    plural = ("es" if what.endswith("h") else "s") * (len(spans) > 1)
    return f"{len(spans)} {what}{plural} {treatment}, at {places}"


def merge_spans(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Join spans that overlap: several shapes may make one glitch."""
    joined: list[tuple[float, float]] = []
    for begin, end in sorted(spans):
        if joined and begin <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(end, joined[-1][1])
        else:
            joined.append((begin, end))
    return joined
