"""Masks of an experiment: saturation, spikes and glitches.

Where a commanded force is at the limit of its authority, the force that acted is unknown. The equation holds
sample by sample: what is masked takes nothing else with it but the reach of low-pass and stencils.
"""

from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.findings import Finding
from fit.parallel import parallel_map
from fit.quality import samples, saturation
from fit.quality.glitches import GlitchResult, describe_spans, remove_glitches
from fit.quality.injections import chance_probability, is_excessive
from fit.requirements import MOST_SATURATED
from fit.settings import Settings
from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.whitening import Experiment, Run

SATURATED, TOO_LONG = "saturated", "saturated_too_long"  # codes of the warnings
MODEL_MISFIT = "model_misfit"  # likewise


def without_saturation(run: Run) -> tuple[Run, tuple[Finding, ...]]:
    """Mask where a commanded force along x has reached its authority.

    Returns
    -------
    run : Run
        With those stretches masked; as it was if they would cost more than `MOST_SATURATED` of it.
    findings : tuple of Finding
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
        return run, (Finding(TOO_LONG, f"{message}; {cost}, so nothing is masked", telemetry.run),)
    message = f"{message}; these are masked, {100 * weight:.3g} % is left"
    return masked, (Finding(SATURATED, message, telemetry.run, spans=tuple(stretches)),)


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


def _spikes(run: Run) -> tuple[Finding, ...]:
    """Return the spikes, which are all that is masked so far, if there are any."""
    if not run.masks:
        return ()
    name = run.telemetry.run
    message = f"{name}: {describe_spans(run.masks, 'masked', 'spike')}"
    return (Finding("glitches", message, name, spans=tuple(run.masks)),)


def _stretches(telemetry: Telemetry, flags: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return begin and end [s] of every stretch, with the reach of the low-pass."""
    taps, _ = derivatives.low_pass(telemetry.fs)
    reach = taps.size / 2 / telemetry.fs
    time = telemetry.time
    return [
        (float(time[begin] - reach), float(time[end - 1] + reach))
        for begin, end in derivatives.true_runs(flags)
    ]


def glitch_search_enabled(settings: Settings) -> bool:
    """Return whether glitches are searched for; flscov interpolates masked samples, so never there."""
    return settings.glitches and settings.estimator != "flscov"


def _without_saturation(experiment: Experiment) -> tuple[Experiment, list[Finding]]:
    """Return an experiment without what is saturated, and what is found of spikes and saturation."""
    masked, findings = [], []
    for run in filter(None, (experiment.sysid, experiment.noise)):
        unsaturated, saturated = without_saturation(run)
        masked.append(unsaturated)
        findings += [*_spikes(run), *saturated]
    return replace(experiment, sysid=masked[0], noise=masked[1] if experiment.noise else None), findings


def mask_experiments(
    experiments: Sequence[Experiment], settings: Settings, faulty: Container[str]
) -> tuple[list[Experiment], list[Finding]]:
    """Mask saturation and glitches; no glitches in those that are `faulty`.

    Spikes are masked already, see `mask_spikes`.

    One that cannot be masked must not cost the others their fit: a finding says why it is missing. Where the
    glitches of an experiment, or of all, lie in the injections more often than chance allows, the equation
    lacks a signal there: those of the sysid runs are discarded, and the finding is ``model_misfit``.
    """
    n_tests = len(experiments) + 1

    def search(e: Experiment) -> tuple[Experiment, list[Finding], GlitchResult | None] | Finding:
        try:
            unsaturated, found = _without_saturation(e)
            # what is saturated would pass for glitches
            usable = e.name not in faulty and all(finding.code != TOO_LONG for finding in found)
            if not (usable and glitch_search_enabled(settings)):
                return unsaturated, found, None
            return unsaturated, found, remove_glitches(unsaturated, len(experiments))
        except InputError as error:
            return Finding("invalid_data", str(error), e.name)

    results = parallel_map(search, experiments, Experiment.samples)
    findings = [result for result in results if isinstance(result, Finding)]
    searched = [result for result in results if not isinstance(result, Finding)]
    counts = {e.name: glitches.coincidences for e, _, glitches in searched if glitches}
    misfits = {
        name: chance_probability([count]) for name, count in counts.items() if is_excessive([count], n_tests)
    }
    rest = {name: count for name, count in counts.items() if name not in misfits}
    if is_excessive([*rest.values()], n_tests):
        p_value = chance_probability([*rest.values()])
        misfits |= {name: p_value for name, count in rest.items() if count.both}
    masked = []
    for e, found, glitches in searched:
        findings += found
        if glitches and e.name in misfits:
            glitches = glitches.discard_sysid()
            findings.append(_misfit(glitches, misfits[e.name]))
        masked.append(glitches.experiment if glitches else e)
        findings += glitches.findings if glitches else ()
    return masked, findings


def _misfit(glitches: GlitchResult, p_value: float) -> Finding:
    """Return that the equation lacks a signal at the injections."""
    count = glitches.coincidences
    run = glitches.experiment.sysid.telemetry.run
    message = (
        f"{run}: the equation of motion lacks a signal at the injections: of "
        f"{count.glitches} stretches with an excess {count.both} are injected, {count.expected:.2g} expected "
        f"by chance (p = {p_value:.1g}); nothing is masked"
    )
    return Finding(MODEL_MISFIT, message, run)
