"""The experiments on their way through the pipeline: which are in the joint fit, which are not, and why."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fit.errors import InputError
from fit.quality.exclusions import Exclusion, join_messages
from fit.quality.masks import MaskedExperiment
from fit.warnings import Cause, FitWarning
from fit.whitening import Experiment


@dataclass(frozen=True)
class ExperimentSet:
    """All experiments of a calibration, masked.

    Attributes
    ----------
    prepared : mapping of str to MaskedExperiment
        By name.
    in_joint_fit : tuple of Experiment
    short, excluded : tuple of Experiment
        Those that are not in the joint fit because of their duration, or by the settings.
    exclusions : tuple of Exclusion
        Those that are not because of a fault; some of them could not even be masked.
    notes : tuple of FitWarning
        Faults that most of the experiments have in common.
    """

    prepared: Mapping[str, MaskedExperiment]
    in_joint_fit: tuple[Experiment, ...]
    short: tuple[Experiment, ...]
    excluded: tuple[Experiment, ...]
    exclusions: tuple[Exclusion, ...] = ()
    notes: tuple[FitWarning, ...] = ()

    @property
    def experiments(self) -> list[Experiment]:
        """All that could be masked."""
        return [masked.experiment for masked in self.prepared.values()]

    @property
    def usable(self) -> list[Experiment]:
        """Those without a fault, in the joint fit or not."""
        faulty = {exclusion.experiment for exclusion in self.exclusions}
        return [e for e in self.experiments if e.name not in faulty]

    def exclude(self, exclusions: Sequence[Exclusion]) -> "ExperimentSet":
        """Return the set with more exclusions.

        Raises
        ------
        InputError
            If no experiment remains for the joint fit.
        """
        faulty = {exclusion.experiment for exclusion in exclusions}
        remaining = tuple(e for e in self.in_joint_fit if e.name not in faulty)
        if exclusions and not remaining and (self.in_joint_fit or not self.prepared):
            raise InputError(join_messages((*self.exclusions, *exclusions)))
        return replace(self, in_joint_fit=remaining, exclusions=(*self.exclusions, *exclusions))

    def exclude_unusable(self) -> "ExperimentSet":
        """Return the set without experiments that masks would take apart, unless all of them are such."""
        reasons = {e.name: self.prepared[e.name].unusable for e in self.in_joint_fit}
        unusable = [
            Exclusion(name, (Cause(name, "", "masks", words=reason),), single_fit_code="", evidence="cause")
            for name, reason in reasons.items()
            if reason
        ]
        return self if len(unusable) == len(reasons) else self.exclude(unusable)

    def with_warnings(self, warnings: Mapping[str, tuple[FitWarning, Experiment]]) -> "ExperimentSet":
        """Return the set with a warning for some experiments, by name, and each as it is to be fitted now."""
        prepared = {n: p.with_warning(*warnings[n]) if n in warnings else p for n, p in self.prepared.items()}

        def updated(experiments: tuple[Experiment, ...]) -> tuple[Experiment, ...]:
            return tuple(prepared[e.name].experiment if e.name in prepared else e for e in experiments)

        return replace(
            self,
            prepared=prepared,
            in_joint_fit=updated(self.in_joint_fit),
            short=updated(self.short),
            excluded=updated(self.excluded),
        )

    def warnings_of(self, name: str) -> tuple[FitWarning, ...]:
        """Return the faults that keep an experiment out of the joint fit, as warnings of its single fit."""
        return tuple(
            w
            for exclusion in self.exclusions
            if exclusion.experiment == name
            for w in exclusion.single_fit_warnings
        )

    def notes_of(self, name: str) -> tuple[FitWarning, ...]:
        """Return the notes of which a cause concerns an experiment, or all of them."""
        experiment = self.prepared[name].experiment
        runs = [run.telemetry.run for run in (experiment.sysid, experiment.noise) if run]
        names = {"", name, *runs}
        return tuple(note for note in self.notes if any(cause.run in names for cause in note.causes))
