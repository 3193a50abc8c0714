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

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError
from fit.false_alarms import sigma_limit
from fit.model import dynamics
from fit.quality.first_fit import first, flight_psd, least
from fit.quality.injections import Coincidences, coincidences, injected_cells
from fit.quality.matching_pursuit import FAMILY, matching_pursuit
from fit.quality.whitened_templates import WhitenedTemplates
from fit.spectra import NoiseModel, Spectra, Spectrum, derivatives, fit_noise, windowing
from fit.telemetry import axis_part
from fit.warnings import FitWarning, TimeSpan
from fit.whitening import Experiment, Glitch, Run, whitened_run

Array = NDArray[np.float64]

WIDTHS = (0.0, 1.5, 3.0, 6.0, 12.0, 24.0)  # s, standard deviations of the bell curves
BETWEEN = 1.2  # a series is 1.155 times higher at most between six samples in its shortest period; noise, 4 %
REACH = 2.2  # widths on either side of a glitch that are masked along
LEAST_REACH = 2.0  # s, the same; the stencils add some 10 s, as they do to missing samples
HIGHEST = 0.3  # of the highest ratio: what is lower may be due to what is higher
ROUNDS = 60  # to get from the highest ratio to the threshold, in both runs
LONGER = 1.2  # a mask goes with any shape, so that one must be that much clearer than a bell curve
RAISED = 0.5  # noise of the narrowest bell curve, relative to the PSD, that a short glitch has raised
MOST_GLITCHES = 0.6  # of the weight of a run; if masks would take more, it is no matter of glitches
PATCHED = 60.0  # s; a patch that is longer may hide the onset of a long glitch, which is then not found
MOST_IMPULSES = 100  # that patches are made of; with more, all masks are cut out of the window
MOST_SHAPES = 40  # that are taken out of a run; beyond, the same
TAKEN_OUT = "fitted along and taken out"
TOO_MANY = "too_many_glitches"  # code of the warning where nothing was masked
_TOGETHER = 2  # transforms: faster than one by one, where all of them would fill the memory
_GAUSSIAN = 1.4826  # standard deviation over median absolute deviation


@dataclass(frozen=True)
class GlitchResult:
    """What a search for glitches has found in an experiment.

    Attributes
    ----------
    searched : Experiment
        The runs as they were.
    experiment : Experiment
        The runs with short glitches masked and long ones fitted along.
    warnings : mapping of str to FitWarning
        By name of the run, where there are glitches, or too many.
    coincidences : Coincidences
        Glitches and injections of both runs.
    """

    searched: Experiment
    experiment: Experiment
    warnings: Mapping[str, FitWarning]
    coincidences: Coincidences

    def discard_sysid(self) -> "GlitchResult":
        """Return the result without what was found in the sysid run."""
        sysid = self.searched.sysid
        warnings = {name: w for name, w in self.warnings.items() if name != sysid.telemetry.run}
        return replace(self, experiment=replace(self.experiment, sysid=sysid), warnings=warnings)


def remove_glitches(experiment: Experiment, n_experiments: int = 1) -> GlitchResult:
    """Mask the short glitches of an experiment and fit the shapes of the long ones along.

    A run that would lose more than `MOST_GLITCHES` to masks, or need more than `MOST_SHAPES`, is left as it
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
    initial = first(experiment.sysid)
    sysid = _Search(experiment.sysid, initial.tau, 2 * n_experiments)
    noise = _Search(experiment.noise, initial.tau, 2 * n_experiments) if experiment.noise else None
    searches = [sysid, noise] if noise else [sysid]
    for iteration in range(ROUNDS):
        sysid.weigh(None if iteration else initial.c)
        if noise:
            noise.weigh(noise.named(sysid.coefficients))
        # the noise weighs: it goes first
        if not any(search.look(noise) for search in reversed(searches)):
            break
        if sysid.found and sysid.coincidences.significant(n_experiments + 1):
            break
    cleaned = Experiment(sysid.run.loosened(), noise.run.loosened() if noise else None)
    warnings = {search.run.telemetry.run: search.warning() for search in searches if search.found}
    total = sum((search.coincidences for search in searches), Coincidences())
    return GlitchResult(experiment, cleaned, warnings, total)


@dataclass(frozen=True)
class _Heard:
    """What bell curves find in a run at every instant, as a signal-to-noise ratio.

    The noise is that of the noise run, if there is one, unless the residual itself shows more. How much it
    shows is told by a median, which glitches hardly move.

    Attributes
    ----------
    terms : Spectra
        The run.
    residual : ndarray of complex, shape (B,)
        Of it, whitened.
    S : ndarray, shape (B,)
        PSD of the noise.
    least : float
        The noise in what is found, in units of what S tells, at least.
    n_runs : int
        Number of runs of the campaign that are searched.
    """

    terms: Spectra
    residual: Spectrum
    S: Array
    least: float
    n_runs: int = 1

    @cached_property
    def threshold(self) -> float:
        """Signal-to-noise ratio of a glitch: for as many tests as there are runs, widths and bins."""
        return sigma_limit(FAMILY, self.n_runs * len(WIDTHS) * 2 * self.terms.f.size)

    def answers(self, n: int) -> Iterator[tuple[Array, float]]:
        """Yield what each of the curves finds if the noise is S, shape (n,), and the noise in that."""
        window, f = self.terms.window, self.terms.f
        seen = window[np.arange(n) * window.size // n] > 0.5
        size = n / 2 * np.sqrt(np.mean(window**2))  # noise S: variance 1
        for i in range(0, len(WIDTHS), _TOGETHER):
            widths = np.array(WIDTHS[i : i + _TOGETHER])
            curves = np.exp(-2 * (np.pi * widths[:, None] * f) ** 2) / np.sqrt(self.S)
            curves *= size / np.linalg.norm(curves, axis=1, keepdims=True)
            for found in windowing.inverse_transform((self.residual * curves).T, self.terms.first, n).T:
                np.abs(found, out=found)
                yield found, max(_GAUSSIAN * float(np.median(found[seen])), self.least)

    def ratios(self) -> Iterator[Array]:
        """Yield the ratio that each of the curves finds, shape (N,)."""
        for found, sigma in self.answers(self.terms.window.size):
            found /= sigma if sigma > 0 else np.inf
            yield found

    @property
    def quiet(self) -> bool:
        """Whether nothing stands out, as far as fewer instants than the run has are enough to tell."""
        n, last = self.terms.window.size, self.terms.first + self.terms.f.size
        answers = self.answers(min(scipy.fft.next_fast_len(6 * last, real=True), n))
        return all(float(found.max()) * BETWEEN < self.threshold * sigma for found, sigma in answers)

    @property
    def loudest(self) -> float:
        """The highest of all."""
        return max(float(ratio.max()) for ratio in self.ratios())

    @cached_property
    def highest(self) -> Array:
        """That of what stands out most, shape (N,)."""
        highest = np.zeros(self.terms.window.size)
        for ratio in self.ratios():
            np.maximum(highest, ratio, out=highest)
        return highest

    @property
    def narrowest(self) -> float:
        """Noise of the narrowest, in units of what S tells."""
        return next(self.answers(self.terms.window.size))[1]

    def widths(self, at: Sequence[int]) -> Array:
        """Return the widths [s] of those that stand out most at samples of these numbers."""
        widest = np.argmax([ratio[at] for ratio in self.ratios()], axis=0)
        return np.asarray(np.array(WIDTHS)[widest])

    def bell(self, stretch: slice) -> float:
        """Return the highest that there is in a stretch if the noise is S."""
        answers = self.answers(self.terms.window.size)
        return max(float(np.max(found[stretch], initial=0.0)) for found, _ in answers)


class _Search:
    """The search for glitches in one run.

    Parameters
    ----------
    run : Run
        As it is.
    tau : tuple of float
        Delays [s] about which its columns are expanded.
    n_runs : int
        Number of runs of the campaign that are searched.

    Attributes
    ----------
    run : Run
        Without what has been found so far.
    found, hopeless : bool
        Whether there was anything, and whether it was too much.
    """

    def __init__(self, run: Run, tau: tuple[float, float], n_runs: int) -> None:
        self.run, self._original, self._n_runs = run, run, n_runs
        self.found = self.hopeless = False
        self._flags = np.zeros_like(run.channels.valid)
        self._shapes: list[Glitch] = []
        self._names = (*dynamics.COLUMNS, *run.channels.parameters[len(dynamics.PARAMETERS) :])
        self._model: NoiseModel | None = None
        self._left: tuple[Array, Array, Array] | None = None
        self._tau = tau

    def weigh(self, c: Array | None) -> None:
        """Take the coefficients of the columns, shape (P,), or fit them, and what they leave for noise."""
        terms = self.run.spectra(self._tau)
        S = self._S(terms.f)
        self._c = least(whitened_run.whiten(terms, S)[0]) if c is None else c
        z, left = whitened_run.whiten(terms.summed(self._c), S)
        self._left = terms.f, np.abs(z[:, 0]) ** 2 * S / 2, np.maximum(left, 0)

    @property
    def coefficients(self) -> dict[str, float]:
        """Those of the columns, by name."""
        return dict(zip(self._names, self._c.tolist(), strict=True))

    def named(self, coefficients: Mapping[str, float]) -> Array:
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
        if not self.found or self._original.telemetry.kind == "noise":
            return None
        return injected_cells(self._original, self._tau)

    def _S(self, f: Array) -> Array:
        """Return the PSD of what is left, shape (B,), at first the shape it had in flight."""
        if self._left:  # most are never asked for, as the noise run tells it
            with suppress(FitError):  # where glitches spoil the residual that much, the PSD before has to do
                self._model = fit_noise(*self._left)
            self._left = None
        return self._model.expected(f) if self._model else flight_psd(f)

    def look(self, noise: "_Search | None") -> bool:
        """Mask or take out what stands out of the noise most; False if nothing does."""
        if self.hopeless:
            return False
        terms = self.run.spectra(self._tau)
        S = (noise or self)._S(terms.f)
        U, _ = whitened_run.whiten(terms, S)
        heard = _Heard(terms, U @ self._c, S, 0.0 if noise in (self, None) else 1.0, self._n_runs)
        loud = not heard.quiet and heard.loudest > heard.threshold
        # of what is raised at the highest frequencies nothing long is the cause, and it hides what is
        short = loud and heard.narrowest < RAISED
        view = None if short else self._view(noise, S, U)
        del U  # it fills the memory, with that of a long run
        long = matching_pursuit(view) if view else []
        clear = [found.glitch for found in long if found.snr > LONGER * self._about(found.glitch, heard)]
        if clear:
            self._shapes += clear
        elif loud:
            self._mask(heard)
        elif long:
            self._shapes += [found.glitch for found in long]
        else:
            return False
        self.found = True
        time = self.run.channels.time
        stretches = [(float(time[a]), float(time[b - 1])) for a, b in derivatives.true_runs(self._flags)]
        masked = self._original.without(stretches)
        self.hopeless = (
            masked.weight < (1 - MOST_GLITCHES) * self._original.weight or len(self._shapes) > MOST_SHAPES
        )
        if self.hopeless:
            self.run = self._original
        else:
            brief = [(begin, end) for begin, end in stretches if end - begin <= PATCHED]
            patched = self._original.patched(brief)
            impulses = patched.impulses(time, self.run.channels.fs)
            if impulses is not None and impulses.size <= MOST_IMPULSES:
                masked = patched.without([stretch for stretch in stretches if stretch not in brief])
            self.run = masked.free_of(self._shapes)
        return True

    def _about(self, glitch: Glitch, heard: _Heard) -> float:
        """Return what a bell curve finds where a glitch is notable, at most."""
        start, fs, (begin, end) = self.run.channels.time[derivatives.HALF], self.run.channels.fs, glitch.span
        first, last = (round((t - start) * fs) for t in (begin - WIDTHS[-1], end + WIDTHS[-1]))
        return heard.bell(slice(max(first, 0), max(last, 0)))

    def _mask(self, heard: _Heard) -> None:
        """Flag what stands out."""
        fs, highest = self.run.channels.fs, heard.highest
        loud = derivatives.true_runs(highest > max(heard.threshold, HIGHEST * float(highest.max())))
        peaks = [begin + int(np.argmax(highest[begin:end])) for begin, end in loud]
        for peak, width in zip(peaks, heard.widths(peaks), strict=True):
            reach, middle = int(np.ceil(max(LEAST_REACH, REACH * width) * fs)), peak + derivatives.HALF
            self._flags[max(0, middle - reach) : middle + reach + 1] = True
        for begin, end in derivatives.true_runs(~self._flags):
            if begin > 0 and end < self._flags.size and end - begin <= 2 * derivatives.HALF:
                self._flags[begin:end] = True  # the stencils leave nothing of it

    def _view(self, noise: "_Search | None", S: Array, U: Spectrum) -> WhitenedTemplates:
        """Return the run as the pursuit sees it, whitened by the PSD S of its noise or of its noise run."""
        terms = self.run.spectra(self._tau)
        transformed = slice(derivatives.HALF, derivatives.HALF + terms.window.size)
        taken = [terms.nuisance * np.sqrt(2 / S)[:, None]]
        if self is not noise:  # the coefficients of a noise run are those of the sysid run
            taken.append(U[:, 1:][:, np.any(U[:, 1:] != 0, axis=0)])
        beside = np.asfortranarray(np.concatenate(taken, axis=1))
        beside /= np.linalg.norm(beside, axis=0)
        Q, residual = (
            whitened_run.orthonormal(whitened_run.stacked(beside)),
            whitened_run.stacked(U @ self._c),
        )
        return WhitenedTemplates(
            time=axis_part(self.run.channels, transformed),
            fs=self.run.channels.fs,
            f=terms.f,
            S=S,
            window=terms.window,
            residual=residual - Q @ (Q.T @ residual),
            Q=Q,
            own=noise in (self, None),
            known=tuple(self._shapes),
            n_runs=self._n_runs,
        )

    def warning(self) -> FitWarning:
        """Say what was found."""
        name = self.run.telemetry.run
        if self.hopeless:
            message = (
                f"{name}: to mask all that stands out of the noise would cost more than "
                f"{100 * MOST_GLITCHES:g} % of the run, or take more than {MOST_SHAPES} shapes, which is no "
                "matter of glitches; nothing is masked"
            )
            return FitWarning(TOO_MANY, (), message)
        masks, end = (
            sorted(self.run.masks[len(self._original.masks) :]),
            float(self.run.telemetry.instants(slice(-1, None))[0]),
        )
        taken_out = merged([(max(a, 0.0), min(b, end)) for a, b in (g.span for g in self._shapes)])
        told = [placed(s, what) for s, what in ((masks, "masked"), (taken_out, TAKEN_OUT)) if s]
        spans = tuple(TimeSpan(name, *span) for span in sorted([*masks, *taken_out]))
        return FitWarning("glitches", (), f"{name}: {'; '.join(told)}", spans=spans)


def placed(spans: Sequence[tuple[float, float]], what: str) -> str:
    """Say how many glitches there are, what was done with them, and where."""
    where = ", ".join(f"{a:.0f} s ({b - a:.0f} s)" for a, b in spans)
    return f"{len(spans)} glitch{'es' * (len(spans) > 1)} {what}, at {where}"


def merged(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Join spans that overlap: several shapes may make one glitch."""
    found: list[tuple[float, float]] = []
    for begin, end in sorted(spans):
        if found and begin <= found[-1][1]:
            found[-1] = found[-1][0], max(end, found[-1][1])
        else:
            found.append((begin, end))
    return found
