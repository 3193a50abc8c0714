"""The search for a few tones within the limits that come near the bound."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.campaign import Campaign
from lpfcosim.experiment_design import convex_bound, limits, tones
from lpfcosim.experiment_design.convex_bound import Optimum
from lpfcosim.experiment_design.design_problem import DesignProblem, with_tones
from lpfcosim.experiment_design.designed_experiment import HIGHEST, LOWEST, DesignedExperiment
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.multisine import NORMS, Multisine, Solution, ToneWindow, evaluate, improve
from lpfcosim.experiment_design.tones import Tone

Array = NDArray[np.float64]

SETTLING_TIME = 600.0  # s that a run goes on after its tones: what follows them is checked as well
FLANK, RAMP = 0.05, 1080.0  # share of a run under a flank of the window; s, longest rise of a tone
SHORT_RAMP = 300.0  # s, where rms is what counts: tones clear of the flanks make the most of it
SLOWEST = 0.75e-3  # Hz, the slow tone of which all tones are harmonics where peaks are limited
SPREAD = 24  # frequencies beside those of the programme, where rms alone is limited
FAINT = 0.02  # of the largest tone: size of those that the programme does without
STEPS = (24, 16, 12, 8)  # of fewer and fewer tones in a loop
FINAL_NORMS = (*NORMS, 256.0, 512.0)  # that stand for a peak at the end


@dataclass(frozen=True)
class Design:
    """A design.

    Attributes
    ----------
    problem : DesignProblem
        What was sought.
    optimum : Optimum
        The best power, and the bound.
    tones : mapping of str to tuple of Tone
        By experiment.
    campaign : Campaign
        With these tones.
    sigmas_after : mapping of str to float
        Sigmas to expect of it.
    complete : bool
        False if the search was interrupted.
    """

    problem: DesignProblem
    optimum: Optimum
    tones: Mapping[str, tuple[Tone, ...]]
    campaign: Campaign
    sigmas_after: Mapping[str, float]
    complete: bool

    @property
    def sigma_bounds(self) -> dict[str, float]:
        """By parameter, the sigma that no design within the limits goes below."""
        problem = self.problem
        scale = [problem.sigmas_before[name] for name in problem.parameters]
        bounds = (self.optimum.sigma_bounds * scale).tolist()
        return dict(zip(problem.parameters, bounds, strict=True))

    @property
    def value(self) -> float:
        """The objective by the forecast of the new campaign."""
        initial, final = self.problem.sigmas_before, self.sigmas_after
        ratios = [final.get(name, np.inf) / initial[name] for name in self.problem.parameters]
        return float(np.exp(self.problem.objective.weights @ np.log(ratios)))

    @property
    def efficiency(self) -> float:
        """The bound of the objective over what was reached."""
        return self.optimum.bound / self.value


def search(
    problem: DesignProblem,
    fit_model: FitModel,
    on_bound: Callable[[float, float], None],
    on_value: Callable[[str, float], None],
) -> Design:
    """Return the best tones that are found; interrupted, the best so far.

    Parameters
    ----------
    problem : DesignProblem
        What is sought.
    fit_model : FitModel
        Forecasts the sigmas.
    on_bound : callable
        Called with value and bound of the programme.
    on_value : callable
        Called with a step of the search, and the objective that its tones reach.

    Raises
    ------
    KeyboardInterrupt
        If it comes before any tones are found.
    """
    optimum = convex_bound.optimize_power(problem, on_bound)
    solution, complete = None, True
    try:
        for step, solution in _steps(problem, optimum):
            on_value(step, solution.value)
    except KeyboardInterrupt:
        complete = False
    if solution is None:
        raise KeyboardInterrupt
    scaled = [replace(m, amplitudes=m.amplitudes / _ratios(m).max()) for m in solution.multisines]
    solution = evaluate(problem, scaled)
    tones_of = {
        m.experiment.run.experiment: tones.describe_tones(m, solution.information, problem)
        for m in solution.multisines
    }
    injections = {name: [tone.injection for tone in designed] for name, designed in tones_of.items()}
    campaign = with_tones(problem.plan, injections)
    return Design(problem, optimum, tones_of, campaign, fit_model.sigmas(campaign), complete)


def _steps(problem: DesignProblem, optimum: Optimum) -> Iterator[tuple[str, Solution]]:
    """Yield fewer and fewer tones at the limits, at last as few as asked, with tightened limits."""
    sines = problem.plan.design.sines
    generator = np.random.default_rng(problem.plan.seed)
    solution = improve(problem, _initial_tones(problem, optimum, generator))
    for count in (*(n for n in STEPS if n > sines), sines):
        fewer = [multisine.strongest(count) for multisine in solution.multisines]
        solution = improve(problem, fewer, FINAL_NORMS if count == sines else NORMS)
        yield f"{count} sines in a loop", solution
    tightened = []
    for multisine in solution.multisines:
        reached = _ratios(multisine)
        margins = multisine.margins / np.where(reached > 0.9, reached, 1.0)
        tightened.append(replace(multisine, margins=margins))
    yield "in the time domain", improve(problem, tightened, FINAL_NORMS)


def _initial_tones(
    problem: DesignProblem, optimum: Optimum, generator: np.random.Generator
) -> list[Multisine]:
    """Return many tones, as large as the programme has them, with drawn phases.

    Where peaks are limited, they are all harmonics of one slow tone. Only such tones keep their phases to
    each other, and make waves that are flatter than a sine. Where rms alone is limited, phases are free, and
    the tones are those of the convex programme.
    """
    multisines = []
    for experiment, f, amplitudes in zip(
        problem.experiments, optimum.frequencies, optimum.amplitudes, strict=True
    ):
        window = _tone_window(experiment)
        frequencies = _candidates(problem, experiment, window, f[np.argsort(-amplitudes.max(axis=1))])
        numbers = np.unique(np.round(frequencies * window.length).astype(np.intp))
        n_loops = amplitudes.shape[1]
        number, loop = np.repeat(numbers, n_loops), np.tile(np.arange(n_loops), numbers.size)
        phases = np.exp(2j * np.pi * generator.uniform(size=number.size))
        margins = np.ones(len(experiment.active_limits))
        multisine = Multisine(experiment, window, number, loop, phases, margins)
        nearest = np.argmin(np.abs(numbers[:, None] / window.length - f), axis=0)
        largest = np.zeros((numbers.size, n_loops))
        np.maximum.at(largest, nearest, amplitudes)
        size = largest.ravel() / multisine.units
        multisines.append(replace(multisine, amplitudes=np.maximum(size, FAINT * size.max()) * phases))
    return multisines


def _candidates(
    problem: DesignProblem, experiment: DesignedExperiment, window: ToneWindow, peaks: Array
) -> Array:
    """Return frequencies of tones [Hz], multiples of the inverse of a window, apart and allowed."""
    spec = problem.plan.design
    if any(limit.is_peak_limit for limit in experiment.active_limits):
        slowest = max(SLOWEST, spec.spacing, LOWEST / experiment.model.duration)
        step = int(np.ceil(window.length * slowest))
        candidates = np.arange(step, int(HIGHEST * window.length) + 1, step)
    else:
        spread = experiment.frequencies(SPREAD, spec.forbidden)
        candidates = np.round(np.concatenate([peaks, spread]) * window.length).astype(int)
    candidates = candidates[experiment.allowed(candidates / window.length, spec.forbidden)]
    spacing = int(np.ceil(spec.spacing * window.length))
    numbers: list[int] = []
    for k in candidates.tolist():
        if all(abs(k - neighbour) >= spacing for neighbour in numbers):
            numbers.append(k)
    return np.array(numbers) / window.length


def _tone_window(experiment: DesignedExperiment) -> ToneWindow:
    """Return when the tones of an experiment are on."""
    duration = experiment.model.duration
    flank = FLANK * duration
    if not any(limit.is_peak_limit for limit in experiment.active_limits):
        start = round(max(flank - SHORT_RAMP, 0.0))
        return ToneWindow(start, duration - max(start, SETTLING_TIME), min(SHORT_RAMP, flank))
    return ToneWindow(0.0, duration - SETTLING_TIME, min(flank, RAMP))


def _ratios(multisine: Multisine) -> Array:
    """Return how far the tones of an experiment reach each of its limits in the time domain."""
    experiment = multisine.experiment
    run = replace(experiment.run, injections=tones.injections(multisine))
    ratios = limits.limit_ratios(run, experiment.active_limits, limits.tone_response(run))
    return np.array([ratios[limit.name] for limit in experiment.active_limits])
