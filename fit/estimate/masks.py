"""What is masked before an experiment is fitted: saturation, and glitches.

Where a commanded force is at the limit of its authority, nobody knows which force acted. The equation holds
sample by sample: what is masked takes nothing else with it but the reach of low-pass and stencils.

Glitches are short forces on a test mass, found in the residual of each run. In closed loop a force of seconds
moves the bodies for hours, but the calibrated Delta g shows the force itself and nothing else: only its own
samples have to go. The search is that for known shapes in coloured noise. The residual of a run, windowed and
whitened as the fit does it, is filtered with bell curves of some widths, which gives the signal-to-noise
ratio of a glitch at every instant.

What the search needs of the dynamics it takes from the run itself: the coefficients of the columns, free of
any model of what experiments share, that leave the least residual. Injected sines are subtracted that way
however far the truth is from the flight's. What stands out most is masked first, because a glitch spoils
coefficients and PSD; then all begins again, until nothing new stands out.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError
from fit.estimate import linear
from fit.estimate.runs import Experiment, Run
from fit.model import dynamics
from fit.paper import FLIGHT
from fit.settings import Settings
from fit.signal import NoiseModel, Spectrum, derivatives, fit_noise
from fit.telemetry import Telemetry
from fit.warnings import FitWarning, Span

Array = NDArray[np.float64]

AT_LIMIT = 0.999  # of the authority, read-outs and rounding of archives apart
MOST_SATURATED = (
    0.3  # of a run; if saturation would take more, nothing is masked and the run cannot be trusted
)
SATURATED, TOO_LONG = "saturated", "saturated_too_long"  # codes of the warnings
THRESHOLD = 6.0  # signal-to-noise ratio; noise alone exceeds 5.25 in 0.35 % of runs of 6 h, 6 in some 5e-5
WIDTHS = (0.0, 1.5, 3.0, 6.0, 12.0, 24.0)  # s, standard deviations of the bell curves
REACH = 2.2  # widths on either side of a glitch that are masked along
LEAST_REACH = 2.0  # s, the same; the stencils add some 10 s, as they do to missing samples
HIGHEST = 0.3  # of the highest ratio: what is lower may be due to what is higher
ROUNDS = 30  # to get from the highest ratio to the threshold
MOST_GLITCHES = 0.6  # of the weight of a run; if masks would take more, it is no matter of glitches
TOO_MANY = "too_many_glitches"  # code of the warning where nothing was masked
_GAUSSIAN = 1.4826  # standard deviation over median absolute deviation
_SPOILT = (TOO_MANY, TOO_LONG)


def without_saturation(run: Run) -> tuple[Run, tuple[FitWarning, ...]]:
    """Mask where a commanded force along x has reached its authority.

    Returns
    -------
    run : Run
        With those stretches masked; as it was if they would cost more than `MOST_SATURATED` of it.
    warnings : tuple of FitWarning
        Code `SATURATED` or `TOO_LONG` if there are any.
    """
    telemetry = run.telemetry
    limits = {
        f"f_x_{j}": F_max / telemetry.m_tm
        for j, F_max in ((1, telemetry.F_max_1), (2, telemetry.F_max_2))
        if F_max > 0  # without authority there is only what leaks
    }
    flags = {name: np.abs(telemetry.channels[name]) >= AT_LIMIT * limit for name, limit in limits.items()}
    at_limit = np.any(list(flags.values()), axis=0) if flags else np.zeros(telemetry.time.size, bool)
    if not at_limit.any():
        return run, ()
    stretches = _stretches(telemetry, at_limit)
    masked = run.without(stretches)
    told = " and ".join(
        f"{name} in {int(of.sum())} samples (F_max_{name[-1]}/m_tm = {limits[name]:.3g} m s-2)"
        for name, of in flags.items()
        if of.any()
    )
    said = f"{telemetry.run}: a commanded force is at the limit of its authority: {told}"
    left = masked.weight / run.weight
    if left < 1 - MOST_SATURATED:
        what = f"to mask that would cost {100 * (1 - left):.0f} % of the run"
        return run, (FitWarning(TOO_LONG, (), f"{said}; {what}, so nothing is masked"),)
    spans = tuple(Span(telemetry.run, *stretch) for stretch in stretches)
    said = f"{said}; these are masked, {100 * left:.3g} % is left"
    return masked, (FitWarning(SATURATED, (), said, spans=spans),)


def _stretches(telemetry: Telemetry, flags: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return begin and end [s] of every stretch, with the reach of the low-pass."""
    taps, _ = derivatives.low_pass(telemetry.fs)
    reach = taps.size / 2 / telemetry.fs
    time = telemetry.time
    return [
        (float(time[begin] - reach), float(time[end - 1] + reach))
        for begin, end in derivatives.stretches(flags)
    ]


def without_glitches(experiment: Experiment) -> tuple[Experiment, tuple[FitWarning, ...]]:
    """Find the glitches of an experiment and mask them.

    Parameters
    ----------
    experiment : Experiment
        The runs.

    Returns
    -------
    experiment : Experiment
        The runs, glitches masked; one that would lose more than `MOST_GLITCHES` by it is left as it was.
    warnings : tuple of FitWarning
        ``glitches`` for every run that has some.

    Raises
    ------
    InputError
        If missing samples leave too little of a run.
    """
    sysid = _Search(experiment.sysid)
    noise = _Search(experiment.noise) if experiment.noise else None
    searches = [sysid, noise] if noise else [sysid]
    for _ in range(ROUNDS):
        coefficients = sysid.weigh()
        if noise:
            noise.weigh(coefficients)
        found = [search.mask(noise) for search in searches]
        if not any(found):
            break
    warnings = tuple(search.warning() for search in searches if search.found)
    return Experiment(sysid.run, noise.run if noise else None), warnings


class _Search:
    """The search for glitches in one run.

    Parameters
    ----------
    run : Run
        As it is.

    Attributes
    ----------
    run : Run
        With what has been found so far masked.
    found, hopeless : bool
        Whether there was anything, and whether it was too much to be masked.
    """

    def __init__(self, run: Run) -> None:
        self.run = self._original = run
        self.found = self.hopeless = False
        self._flags = np.zeros_like(run.channels.valid)
        self._names = (*dynamics.COLUMNS, *run.channels.parameters[len(dynamics.PARAMETERS) :])
        self._model: NoiseModel | None = None
        tau_1, tau_2 = (FLIGHT[f"C_{j}"].value / FLIGHT[f"lambda_{j}"].value for j in (1, 2))
        self._tau = tau_1, tau_2  # where a fit begins: it finds the spectra ready

    def weigh(self, coefficients: Mapping[str, float] | None = None) -> dict[str, float]:
        """Fit the PSD of the residual and, unless they are given, the coefficients of the columns."""
        terms = self.run.spectra(self._tau)
        S = self._S(terms.f)
        U, left = linear.whiten(terms, S)
        if coefficients is None:
            self._c = _least(U)
        else:  # a noise run may carry other read-outs of spacecraft motion than the sysid run
            self._c = np.array([coefficients.get(name, 0.0) for name in self._names])
        with suppress(FitError):  # where glitches spoil the residual that much, the PSD before has to do
            power = np.abs(U @ self._c) ** 2 * S / 2
            self._model = fit_noise(terms.f, power, np.maximum(left, 0))
        return dict(zip(self._names, self._c.tolist(), strict=True))

    def _S(self, f: Array) -> Array:
        """Return the PSD found before, at first the shape that Delta g had in flight, shape (B,)."""
        return self._model.expected(f) if self._model else 1 + (1e-3 / f) ** 2 + (f / 0.03) ** 4

    def mask(self, noise: "_Search | None") -> bool:
        """Mask what stands out of the noise; False if nothing does."""
        ratios = self._ratios(noise)
        highest = ratios.max(axis=0)
        above = derivatives.stretches(highest > max(THRESHOLD, HIGHEST * float(highest.max())))
        if self.hopeless or not len(above):
            return False
        self.found, time, fs = True, self.run.channels.time, self.run.channels.fs
        for begin, end in above:
            peak = begin + int(np.argmax(highest[begin:end]))
            width = WIDTHS[int(np.argmax(ratios[:, peak]))]
            reach, middle = int(np.ceil(max(LEAST_REACH, REACH * width) * fs)), peak + derivatives.HALF
            self._flags[max(0, middle - reach) : middle + reach + 1] = True
        for begin, end in derivatives.stretches(~self._flags):
            if begin > 0 and end < self._flags.size and end - begin <= 2 * derivatives.HALF:
                self._flags[begin:end] = True  # the stencils leave nothing of it
        found = [(float(time[a]), float(time[b - 1])) for a, b in derivatives.stretches(self._flags)]
        masked = self._original.without(found)
        self.hopeless = masked.weight < (1 - MOST_GLITCHES) * self._original.weight
        self.run = self._original if self.hopeless else masked
        return True

    def _ratios(self, noise: "_Search | None") -> Array:
        """Return the signal-to-noise ratio of a glitch of every width at every instant, shape (widths, N).

        The noise is that of the noise run, if there is one, unless the residual itself shows more. How much
        it shows is told by a median, which glitches hardly move.
        """
        terms = self.run.spectra(self._tau)
        n, f = terms.window.size, terms.f
        S = (noise or self)._S(f)
        residual = linear.whiten(terms, S)[0] @ self._c
        least = 0.0 if noise in (self, None) else 1.0
        found = []
        for width in WIDTHS:
            bell = np.exp(-2 * (np.pi * width * f) ** 2) / np.sqrt(S)
            bell *= n / 2 * np.sqrt(np.mean(terms.window**2)) / np.linalg.norm(bell)  # noise S: variance 1
            padded = np.concatenate([[0], residual * bell, np.zeros(n // 2 - f.size)])
            filtered = np.abs(scipy.fft.irfft(padded, n))
            sigma = max(_GAUSSIAN * float(np.median(filtered[terms.window > 0.5])), least)
            found.append(filtered / sigma if sigma > 0 else np.zeros(n))
        return np.array(found)

    def warning(self) -> FitWarning:
        """Say what was found."""
        masks = self.run.masks[len(self._original.masks) :]
        name, n = self.run.telemetry.run, len(masks)
        places = ", ".join(f"{begin:.0f} s ({end - begin:.0f} s)" for begin, end in masks)
        if self.hopeless:
            message = (
                f"{name}: masking all that stands out of the noise would cost more than "
                f"{100 * MOST_GLITCHES:g} % of the run, which is no matter of glitches; nothing is masked"
            )
            return FitWarning(TOO_MANY, (), message)
        message = f"{name}: {n} glitch{'es' * (n > 1)} masked, at {places}"
        return FitWarning("glitches", (), message, spans=tuple(Span(name, *mask) for mask in masks))


def _least(U: Spectrum) -> Array:
    """Return the coefficients of whitened columns, shape (P,), the first of them 1, that leave the least."""
    rows = np.concatenate([U.real, U.imag])
    norms = np.linalg.norm(rows, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    c = np.linalg.lstsq(rows[:, 1:] / scale[1:], -rows[:, 0])[0] / scale[1:]
    return np.array([1.0, *c])


@dataclass(frozen=True)
class Prepared:
    """An experiment ready to be fitted.

    Attributes
    ----------
    experiment : Experiment
        With what is masked.
    warnings : tuple of FitWarning
        What was masked, or could not be.
    """

    experiment: Experiment
    warnings: tuple[FitWarning, ...]

    @property
    def spoilt(self) -> str:
        """Why it is better left out of what others take part in, empty where there is no reason."""
        return "; ".join(w.message for w in self.warnings if w.code in _SPOILT)

    def said(self, more: FitWarning, *, levels: bool) -> "Prepared":
        """Return the same with another warning; with `levels` those of its noise are marginalised."""
        return Prepared(replace(self.experiment, levels=levels), (*self.warnings, more))


def searches(chosen: Settings) -> bool:
    """Tell whether glitches are looked for: flscov bridges what is masked."""
    return chosen.glitches and chosen.estimator != "flscov"


def prepare(experiment: Experiment, chosen: Settings) -> Prepared:
    """Mask what the equation does not hold for.

    Raises
    ------
    InputError
        If missing samples leave too little of a run.
    """
    sysid, told = without_saturation(experiment.sysid)
    noise, told_of_noise = without_saturation(experiment.noise) if experiment.noise else (None, ())
    found = Prepared(Experiment(sysid, noise), (*told, *told_of_noise))
    if not searches(chosen) or found.spoilt:  # what is saturated would pass for glitches
        return found
    cleaned, glitched = without_glitches(found.experiment)
    return Prepared(cleaned, (*found.warnings, *glitched))
