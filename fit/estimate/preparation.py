"""What happens to an experiment before it is fitted: saturation and glitches are masked, and told."""

from collections.abc import Sequence
from dataclasses import dataclass

from fit.estimate import glitches, saturation
from fit.estimate.runs import Experiment
from fit.results import FitWarning
from fit.settings import Settings

_SPOILT = (glitches.TOO_MANY, saturation.TOO_LONG)


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


def prepare(experiments: Sequence[Experiment], chosen: Settings) -> list[Prepared]:
    """Mask what the equation does not hold for.

    Raises
    ------
    InputError
        If missing samples leave too little of a run.
    """
    return [_prepare(e, chosen) for e in experiments]


def _prepare(experiment: Experiment, chosen: Settings) -> Prepared:
    sysid, told = saturation.clean(experiment.sysid)
    noise, told_of_noise = saturation.clean(experiment.noise) if experiment.noise else (None, ())
    found = Prepared(Experiment(sysid, noise), (*told, *told_of_noise))
    # flscov bridges what is masked, and what is saturated would pass for glitches
    if not chosen.glitches or chosen.estimator == "flscov" or found.spoilt:
        return found
    cleaned, glitched = glitches.clean(found.experiment)
    return Prepared(cleaned, (*found.warnings, *glitched))
