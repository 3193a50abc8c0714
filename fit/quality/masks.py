"""Masks of an experiment: saturation, spikes and glitches.

Where a commanded force is at the limit of its authority, the force that acted is unknown. The equation holds
sample by sample: what is masked takes nothing else with it but the reach of low-pass and stencils.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.parallel import parallel_map
from fit.quality import samples, saturation
from fit.quality.glitches import TOO_MANY, GlitchResult, describe_spans, remove_glitches
from fit.quality.injections import chance_probability, is_excessive
from fit.requirements import MOST_SATURATED
from fit.settings import Settings
from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.warnings import FitWarning, TimeSpan
from fit.whitening import Experiment, Run

SATURATED, TOO_LONG = "saturated", "saturated_too_long"  # codes of the warnings
MODEL_MISFIT = "model_misfit"  # likewise
_UNUSABLE = (TOO_MANY, TOO_LONG)


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
    largest = saturation.limits(telemetry)
    limited = {name: saturation.limited(telemetry, name) for name in largest}
    if not any(limits.size for limits in limited.values()):
        return run, ()
    saturated = np.zeros(telemetry.size, dtype=bool)
    for begin, end in np.concatenate(list(limited.values())):
        saturated[begin:end] = True
    stretches = _stretches(telemetry, saturated)
    masked = run.mask(stretches)
    channels = " and ".join(
        f"{name} in {int(np.diff(limits).sum())} samples ({saturation.limit_text(name, largest[name])})"
        for name, limits in limited.items()
        if limits.size
    )
    message = f"{telemetry.run}: a commanded force is at the limit of its authority: {channels}"
    weight = masked.weight / run.weight
    if weight < 1 - MOST_SATURATED:
        cost = f"masking would remove {100 * (1 - weight):.0f} % of the run"
        return run, (FitWarning(TOO_LONG, (), f"{message}; {cost}, so nothing is masked"),)
    spans = tuple(TimeSpan(telemetry.run, *stretch) for stretch in stretches)
    message = f"{message}; these are masked, {100 * weight:.3g} % is left"
    return masked, (FitWarning(SATURATED, (), message, spans=spans),)


def mask_spikes(experiment: Experiment) -> Experiment:
    """Mask samples of read-outs that are apart from those about them, see `samples.outliers`."""
    noise = experiment.noise and _without_spikes(experiment.noise)
    return replace(experiment, sysid=_without_spikes(experiment.sysid), noise=noise)


def _without_spikes(run: Run) -> Run:
    flags = np.zeros(run.telemetry.size, dtype=bool)
    for name in run.spacecraft.read_outs:
        for begin, end in samples.outliers(run.telemetry.channels[name])[0]:
            flags[begin:end] = True
    return run.mask(_stretches(run.telemetry, flags)) if flags.any() else run


def _spike_warnings(run: Run) -> tuple[FitWarning, ...]:
    """Return the warning of spikes that are all that is masked so far, if there are any."""
    if not run.masks:
        return ()
    name = run.telemetry.run
    spans = tuple(TimeSpan(name, *stretch) for stretch in run.masks)
    message = f"{name}: {describe_spans(run.masks, 'masked', 'spike')}"
    return (FitWarning("glitches", (), message, spans=spans),)


def _stretches(telemetry: Telemetry, flags: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return begin and end [s] of every stretch, with the reach of the low-pass."""
    taps, _ = derivatives.low_pass(telemetry.fs)
    reach = taps.size / 2 / telemetry.fs
    time = telemetry.time
    return [
        (float(time[begin] - reach), float(time[end - 1] + reach))
        for begin, end in derivatives.true_runs(flags)
    ]


@dataclass(frozen=True)
class MaskedExperiment:
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
    def unusable(self) -> str:
        """Reason to exclude the experiment from the joint fit, empty if there is none."""
        return "; ".join(w.message for w in self.warnings if w.code in _UNUSABLE)

    def with_warning(self, warning: FitWarning, experiment: Experiment) -> "MaskedExperiment":
        """Return the same with another warning, and the experiment as it is to be fitted now."""
        return MaskedExperiment(experiment, (*self.warnings, warning))


def glitch_search_enabled(settings: Settings) -> bool:
    """Return whether glitches are searched for; flscov interpolates masked samples, so never there."""
    return settings.glitches and settings.estimator != "flscov"


def _masked(experiment: Experiment) -> MaskedExperiment:
    """Return an experiment without what is saturated, and what is said of its masks."""
    sysid, warnings = _masked_run(experiment.sysid)
    noise, noise_warnings = _masked_run(experiment.noise) if experiment.noise else (None, ())
    return MaskedExperiment(replace(experiment, sysid=sysid, noise=noise), (*warnings, *noise_warnings))


def _masked_run(run: Run) -> tuple[Run, tuple[FitWarning, ...]]:
    masked, warnings = without_saturation(run)
    return masked, (*_spike_warnings(run), *warnings)


def mask_experiments(
    experiments: Sequence[Experiment], settings: Settings, faulty: Container[str]
) -> dict[str, MaskedExperiment | InputError]:
    """Mask saturation and glitches, by name of the experiment; no glitches in those that are `faulty`.

    Spikes are masked already, see `mask_spikes`.

    One that cannot be masked must not cost the others their fit: it has the error in its place. Where the
    glitches of an experiment, or of all, lie in the injections more often than chance allows, the equation
    lacks a signal there: those of the sysid runs are discarded, with the warning ``model_misfit``.
    """
    n_tests = len(experiments) + 1

    def searched(e: Experiment) -> tuple[MaskedExperiment, GlitchResult | None] | InputError:
        try:
            unsaturated = _masked(e)
            # what is saturated would pass for glitches
            search = e.name not in faulty and glitch_search_enabled(settings) and not unsaturated.unusable
            return unsaturated, remove_glitches(unsaturated.experiment, len(experiments)) if search else None
        except InputError as error:
            return error

    results = dict(
        zip(
            (e.name for e in experiments),
            parallel_map(searched, experiments, Experiment.samples),
            strict=True,
        )
    )
    counts = {
        name: result[1].coincidences
        for name, result in results.items()
        if not isinstance(result, InputError) and result[1]
    }
    misfits = {
        name: chance_probability([count]) for name, count in counts.items() if is_excessive([count], n_tests)
    }
    rest = {name: count for name, count in counts.items() if name not in misfits}
    if is_excessive([*rest.values()], n_tests):
        p_value = chance_probability([*rest.values()])
        misfits |= {name: p_value for name, count in rest.items() if count.both}

    def masked(name: str) -> MaskedExperiment | InputError:
        result = results[name]
        if isinstance(result, InputError):
            return result
        unsaturated, glitches = result
        if glitches is None:
            return unsaturated
        if name not in misfits:
            return MaskedExperiment(
                glitches.experiment, (*unsaturated.warnings, *(w for _, w in glitches.warnings))
            )
        glitches, misfit = glitches.discard_sysid(), _misfit(glitches, misfits[name])
        return MaskedExperiment(
            glitches.experiment, (*unsaturated.warnings, *(w for _, w in glitches.warnings), misfit)
        )

    return {name: masked(name) for name in results}


def _misfit(glitches: GlitchResult, p_value: float) -> FitWarning:
    """Return the warning that the equation lacks a signal at the injections."""
    count = glitches.coincidences
    run = glitches.experiment.sysid.telemetry.run
    message = (
        f"{run}: the equation of motion lacks a signal at the injections: of "
        f"{count.glitches} stretches with an excess {count.both} are injected, {count.expected:.2g} expected "
        f"by chance (p = {p_value:.1g}); nothing is masked"
    )
    return FitWarning(MODEL_MISFIT, (), message)
