"""What is done to an experiment before it is fitted: saturation is masked, glitches are masked or taken out.

Where a commanded force is at the limit of its authority, nobody knows which force acted. The equation holds
sample by sample: what is masked takes nothing else with it but the reach of low-pass and stencils.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.parallel import parallel_map
from fit.quality import authority
from fit.quality.glitches import TOO_MANY, Hunt
from fit.requirements import MOST_SATURATED
from fit.settings import Settings
from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.warnings import FitWarning, TimeSpan
from fit.whitening import Experiment, Run

SATURATED, TOO_LONG = "saturated", "saturated_too_long"  # codes of the warnings
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
    limited = {name: authority.limited(telemetry, name) for name in ("f_x_1", "f_x_2")}
    if not any(of.size for of in limited.values()):
        return run, ()
    somewhere = np.zeros(telemetry.size, dtype=bool)
    for begin, end in np.concatenate(list(limited.values())):
        somewhere[begin:end] = True
    stretches = _stretches(telemetry, somewhere)
    masked = run.without(stretches)
    told = " and ".join(
        f"{name} in {int(np.diff(of).sum())} samples "
        f"(F_max_{name[-1]}/m_tm = {authority.limit_of(telemetry, name):.3g} m s-2)"
        for name, of in limited.items()
        if of.size
    )
    said = f"{telemetry.run}: a commanded force is at the limit of its authority: {told}"
    left = masked.weight / run.weight
    if left < 1 - MOST_SATURATED:
        what = f"to mask that would cost {100 * (1 - left):.0f} % of the run"
        return run, (FitWarning(TOO_LONG, (), f"{said}; {what}, so nothing is masked"),)
    spans = tuple(TimeSpan(telemetry.run, *stretch) for stretch in stretches)
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
    def spoilt(self) -> str:
        """Why it is better left out of what others take part in, empty where there is no reason."""
        return "; ".join(w.message for w in self.warnings if w.code in _SPOILT)

    def said(self, more: FitWarning, experiment: Experiment) -> "MaskedExperiment":
        """Return the same with another warning, and the experiment as it is to be fitted now."""
        return MaskedExperiment(experiment, (*self.warnings, more))


def searches(chosen: Settings) -> bool:
    """Tell whether glitches are looked for: flscov bridges what is masked."""
    return chosen.glitches and chosen.estimator != "flscov"


def _unsaturated(experiment: Experiment) -> MaskedExperiment:
    sysid, told = without_saturation(experiment.sysid)
    noise, told_of_noise = without_saturation(experiment.noise) if experiment.noise else (None, ())
    return MaskedExperiment(Experiment(sysid, noise), (*told, *told_of_noise))


def mask_experiments(
    experiments: Sequence[Experiment], chosen: Settings, faulty: Container[str]
) -> dict[str, MaskedExperiment | InputError]:
    """Prepare experiments, by name; those that are `faulty` without a search, for they are no good.

    One that cannot be prepared must not cost the others their fit: it has the error in its place. Where the
    equation lacks something in most of them (`Hunt.lacks`) it would pass for hundreds of glitches: in those
    nothing is searched for.
    """

    def begun(e: Experiment) -> tuple[MaskedExperiment, Hunt | None] | InputError:
        try:
            found = _unsaturated(e)
            # what is saturated would pass for glitches
            hunted = e.name not in faulty and searches(chosen) and not found.spoilt
            return found, Hunt(found.experiment) if hunted else None
        except InputError as error:
            return error

    def made(one: tuple[MaskedExperiment, Hunt | None] | InputError) -> MaskedExperiment | InputError:
        if isinstance(one, InputError):
            return one
        found, hunt = one
        try:
            if hunt is None or (common and hunt.lacks):
                return found
            experiment, told = hunt.ended()
            return MaskedExperiment(experiment, (*found.warnings, *told))
        except InputError as error:
            return error

    first = parallel_map(begun, experiments, Experiment.samples)
    hunts = [one[1] for one in first if not isinstance(one, InputError) and one[1]]
    lacking = sum(hunt.lacks for hunt in hunts)
    common = len(hunts) > 2 and 2 * lacking > len(hunts)
    pairs = list(zip(experiments, first, strict=True))
    ended = parallel_map(lambda pair: made(pair[1]), pairs, lambda pair: pair[0].samples())
    return {e.name: found for e, found in zip(experiments, ended, strict=True)}
