"""The experiments on their way through the pipeline, and what becomes of each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fit.errors import InputError
from fit.quality.exclusions import Exclusion, told
from fit.quality.masks import MaskedExperiment
from fit.warnings import FitWarning
from fit.whitening import Experiment


@dataclass(frozen=True)
class ExperimentSet:
    """The experiments, prepared, and what becomes of each.

    Attributes
    ----------
    prepared : mapping of str to MaskedExperiment
        All of them by name.
    taking_part, short, excluded : tuple of Experiment
        Those in the joint fit, and those that are not: for being short, by the settings.
    left_out : tuple of Exclusion
        Those that are not because something is wrong with them; some cannot even be prepared.
    notes : tuple of FitWarning
        What is odd about many of them.
    """

    prepared: Mapping[str, MaskedExperiment]
    taking_part: tuple[Experiment, ...]
    short: tuple[Experiment, ...]
    excluded: tuple[Experiment, ...]
    left_out: tuple[Exclusion, ...] = ()
    notes: tuple[FitWarning, ...] = ()

    @property
    def experiments(self) -> list[Experiment]:
        """All of them."""
        return [p.experiment for p in self.prepared.values()]

    def without(self, found: Sequence[Exclusion]) -> "ExperimentSet":
        """Return the same with more experiments left out.

        Raises
        ------
        InputError
            If that leaves nothing for the joint fit of what there was.
        """
        names = {f.experiment for f in found}
        staying = tuple(e for e in self.taking_part if e.name not in names)
        if found and not staying and (self.taking_part or not self.prepared):
            raise InputError(told((*self.left_out, *found)))
        return replace(self, taking_part=staying, left_out=(*self.left_out, *found))

    @property
    def trusted(self) -> list[Experiment]:
        """Those that nothing is wrong with, taking part or not: others tell nothing of them."""
        out = {f.experiment for f in self.left_out}
        return [e for e in self.experiments if e.name not in out]

    def noted(self, said: Mapping[str, tuple[FitWarning, Experiment]]) -> "ExperimentSet":
        """Return the same with what is said of experiments, and these as they are to be fitted now."""
        prepared = {n: p.said(*said[n]) if n in said else p for n, p in self.prepared.items()}

        def anew(of: tuple[Experiment, ...]) -> tuple[Experiment, ...]:
            return tuple(prepared[e.name].experiment if e.name in prepared else e for e in of)

        taking_part, short, excluded = map(anew, (self.taking_part, self.short, self.excluded))
        return replace(self, prepared=prepared, taking_part=taking_part, short=short, excluded=excluded)

    def said_of(self, name: str) -> tuple[FitWarning, ...]:
        """Return what keeps an experiment out of the joint fit, as warnings of its own fit."""
        return tuple(w for f in self.left_out if f.experiment == name for w in f.of_own)
