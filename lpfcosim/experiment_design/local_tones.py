"""Better frequencies of the tones that calibrate one LISA spacecraft.

Amplitude, start and length of every tone are those of the campaign; its frequency is free, in whole cycles.
It does not exceed the highest one that the campaign injects into the same set point, so that no tone needs
more force. The information of a tone follows from the linear closed loop; information of tones whose
frequencies differ by a cycle or more is added. The result is forecast in full.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.lisa import PlannedLisaExperiment, expected_lisa_fit, tone_information
from fit.parameters import LISA
from fit.results import Fit
from fit.settings import Settings
from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError
from lpfcosim.experiment_design.design_problem import with_tones
from lpfcosim.experiment_design.manoeuvre_runs import MOTIONS
from lpfcosim.linear import response
from lpfcosim.planned_experiments import planned_lisa_experiments
from lpfcosim.spacecraft import Run, Sine

Array = NDArray[np.float64]

MIN_CYCLES = 2  # of a tone, by which a window resolves it
MAX_CANDIDATES = 60  # frequencies of a tone
N_STARTS = 8  # of the search: the campaign, and random ones


@dataclass(frozen=True)
class LocalDesign:
    """Tones of one LISA spacecraft.

    Attributes
    ----------
    plan, campaign : Campaign
        Before and after.
    before, after : Fit
        The fits to expect.
    sigma_bounds : dict of str to float
        By parameter, what no frequencies within the limits go below: the others known, each tone at its best.
    max_frequencies : dict of str to float
        By set point [Hz].
    """

    plan: Campaign
    campaign: Campaign
    before: Fit
    after: Fit
    sigma_bounds: dict[str, float]
    max_frequencies: dict[str, float]

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters whose sigmas count: all but fixed ones."""
        return tuple(name for name, e in self.before.parameters.items() if not e.is_exact)

    @property
    def value(self) -> float:
        """Geometric mean of the sigmas relative to those of the campaign."""
        return _geometric_mean([self.after[name].sigma / self.before[name].sigma for name in self.parameters])

    @property
    def bound(self) -> float:
        """What `value` is not below, whatever the frequencies."""
        return _geometric_mean([self.sigma_bounds[n] / self.before[n].sigma for n in self.parameters])


@dataclass(frozen=True)
class _Tone:
    """A tone whose frequency is free, with the information of each of its candidates, shape (B, P, P)."""

    experiment: str
    sine: Sine
    frequencies: Array
    information: Array

    @property
    def duration(self) -> float:
        return self.sine.end - self.sine.start

    def redesigned(self, candidate: int) -> Sine:
        """Return the sine with the frequency of a candidate, in whole cycles."""
        cycles = round(self.frequencies[candidate] * self.duration)
        return replace(self.sine, frequency=cycles / self.duration, cycles=cycles)


def design_local_tones(plan: Campaign, settings: Settings) -> LocalDesign:
    """Find frequencies that determine the parameters best.

    The geometric mean of all sigmas, relative to those of the campaign, is minimised.

    Raises
    ------
    InputError
        If no sine of the campaign moves a test mass.
    """
    planned = planned_lisa_experiments(plan)
    before = expected_lisa_fit(planned, settings)
    names = tuple(name for name, e in before.parameters.items() if not e.is_exact)
    undetermined = dict.fromkeys(
        name
        for p in planned
        for name in p.experiment.sysid.channels.parameters
        if name not in before.parameters
    )
    runs = [run for run in plan.runs if run.kind == "sysid"]
    max_frequencies: dict[str, float] = {}
    for sine in (i for run in runs for i in _free_sines(run)):
        max_frequencies[sine.into] = max(sine.frequency, max_frequencies.get(sine.into, 0.0))
    if not max_frequencies:
        raise InputError(
            "experiments: no sine moves a test mass, expected one into guidance_o_1, guidance_y_1 or another "
            "set point of a test mass; its frequency is optimised"
        )
    tones = [
        tone
        for run, expected in zip(runs, planned, strict=True)
        if run.experiment not in settings.exclude
        for tone in _tones(run, expected, (*names, *undetermined), max_frequencies)
    ]
    prior = np.diag([LISA[name].sigma ** -2.0 for name in (*names, *undetermined)])
    chosen = _search(tones, prior, len(names))
    campaign = with_tones(plan, _sines(runs, tones, chosen))
    after = expected_lisa_fit(planned_lisa_experiments(campaign), settings)
    max_information = np.diag(prior) + sum(
        np.diagonal(t.information, axis1=1, axis2=2).max(axis=0) for t in tones
    )
    bounds = dict(zip(names, (max_information[: len(names)] ** -0.5).tolist(), strict=True))
    design = LocalDesign(plan, campaign, before, after, bounds, max_frequencies)
    is_better = after.parameters.keys() >= set(names) and design.value < 1
    return design if is_better else replace(design, campaign=plan, after=before)


def _free_sines(run: Run) -> list[Sine]:
    """Return the sines of a run that move test masses; those of attitude and opening serve other purposes."""
    return [i for i in run.injections if isinstance(i, Sine) and i.into not in MOTIONS]


def _tones(
    run: Run,
    planned: PlannedLisaExperiment,
    parameters: Sequence[str],
    max_frequencies: Mapping[str, float],
) -> list[_Tone]:
    """Return the free tones of a run with the information of their candidates about the parameters."""
    sines = _free_sines(run)
    if not sines:
        return []
    system = response.recorded_system(run)
    frequencies = [_candidates(sine, max_frequencies[sine.into]) for sine in sines]
    transfers = [
        sine.amplitude * system.select([sine.into], system.outputs).frequency_response(f)[:, :, 0]
        for sine, f in zip(sines, frequencies, strict=True)
    ]
    motions = dict(zip(system.outputs, np.concatenate(transfers).T, strict=True))
    information = tone_information(planned, parameters, np.concatenate(frequencies), motions)
    ends = np.cumsum([f.size for f in frequencies])[:-1]
    return [
        _Tone(run.experiment, sine, f, (sine.end - sine.start) * per_second)
        for sine, f, per_second in zip(sines, frequencies, np.split(information, ends), strict=True)
    ]


def _candidates(sine: Sine, max_frequency: float) -> Array:
    """Return the frequencies [Hz] that give whole cycles in the time of a sine, its own among them."""
    duration = sine.end - sine.start
    max_cycles = max(sine.cycles, int(max_frequency * duration + 1e-6))
    min_cycles = min(sine.cycles, MIN_CYCLES)
    size = min(MAX_CANDIDATES, max_cycles - min_cycles + 1)
    cycles = np.unique(np.geomspace(min_cycles, max_cycles, size).round())
    return np.asarray(np.union1d(cycles, [sine.cycles]) / duration)


def _search(tones: Sequence[_Tone], prior: Array, n_counting: int) -> list[int]:
    """Return a candidate of every tone, by moving one tone at a time as long as that helps.

    The first `n_counting` parameters count; the others are those that the campaign does not determine.
    """
    rng = np.random.default_rng(0)
    starts = [[int(np.argmin(abs(t.frequencies - t.sine.frequency))) for t in tones]]
    starts += [[int(rng.integers(t.frequencies.size)) for t in tones] for _ in range(N_STARTS - 1)]
    return min((_descent(tones, prior, start, n_counting) for start in starts), key=lambda end: end[0])[1]


def _descent(
    tones: Sequence[_Tone], prior: Array, start: list[int], n_counting: int
) -> tuple[float, list[int]]:
    chosen, value = list(start), np.inf
    while True:
        previous_value = value
        for i, tone in enumerate(tones):
            other_tones = [(t, k) for j, (t, k) in enumerate(zip(tones, chosen, strict=True)) if j != i]
            known = prior + sum(t.information[k] for t, k in other_tones)
            values = _objective(known + tone.information, n_counting)
            values[_conflicts(tone, other_tones)] = np.inf
            chosen[i] = int(values.argmin())
            value = float(values.min())
        if not value < previous_value - 1e-9:
            return value, chosen


def _conflicts(tone: _Tone, other_tones: Sequence[tuple[_Tone, int]]) -> NDArray[np.bool_]:
    """Return which candidates are less than a cycle from another tone at the same time."""
    conflicts = np.zeros(tone.frequencies.size, dtype=bool)
    for other, k in other_tones:
        overlap = other.experiment == tone.experiment and (
            other.sine.start < tone.sine.end and tone.sine.start < other.sine.end
        )
        if overlap:
            spacing = 0.999 / min(tone.duration, other.duration)
            conflicts |= abs(tone.frequencies - other.frequencies[k]) < spacing
    return conflicts


def _objective(information: Array, n_counting: int) -> Array:
    """Return the mean logarithm of the variances that count, shape (B,)."""
    scale = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    inverse = np.linalg.inv(information / (scale[:, :, None] * scale[:, None, :]))
    variances = np.diagonal(inverse, axis1=1, axis2=2) / scale**2
    return np.asarray(np.log(variances[:, :n_counting]).mean(axis=1))


def _sines(runs: Sequence[Run], tones: Sequence[_Tone], chosen: Sequence[int]) -> dict[str, list[Sine]]:
    """Return all sines of each experiment in their order, those of the tones with new frequencies."""
    designed = {(t.experiment, t.sine): t.redesigned(k) for t, k in zip(tones, chosen, strict=True)}
    return {
        run.experiment: [designed.get((run.experiment, i), i) for i in run.injections if isinstance(i, Sine)]
        for run in runs
    }


def _geometric_mean(ratios: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(ratios))))
