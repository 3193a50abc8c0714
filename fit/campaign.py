"""The experiments of a calibration, what is found of them, and the decision on what follows from that."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

from fit.errors import FitError, InputError
from fit.findings import KINDS, Finding, joint_message
from fit.fitting import IRLSResult, fit_experiment
from fit.parallel import parallel_map
from fit.settings import Settings
from fit.whitening import Experiment, divide

MAX_LEFT_OUT = 1 / 3  # of the experiments, for the joint fit of the others to be sound
MAX_NAMED = 2  # findings of a run that a sentence names
LATER = ("implausible_gain", "misfit")  # codes of what was not observed: what was comes first


@dataclass(frozen=True)
class Campaign:
    """The experiments of a calibration and what is found of them.

    Attributes
    ----------
    experiments : mapping of str to Experiment
        By name, as they are to be fitted.
    settings : Settings
        Of the fit, without constraints of parameters.
    findings : tuple of Finding
        What is found; those that leave a run out have the name of its experiment.
    fits : mapping of str to IRLSResult or FitError
        The fit of each experiment by itself.
    """

    experiments: Mapping[str, Experiment]
    settings: Settings
    findings: tuple[Finding, ...] = ()
    fits: Mapping[str, IRLSResult | FitError] = field(default_factory=dict)

    @property
    def faulty(self) -> set[str]:
        """Names of the experiments that are not in the joint fit because of a fault."""
        return {f.run for f in self.findings if f.run and f.kind.excludes and f.kind.unsound}

    @property
    def usable(self) -> list[Experiment]:
        """Those without a fault, in the joint fit or not."""
        faulty = self.faulty
        return [e for e in self.experiments.values() if e.name not in faulty]

    @property
    def candidates(self) -> list[Experiment]:
        """Those of them that the settings do not exclude."""
        return [e for e in self.usable if e.name not in self.settings.exclude]

    @property
    def in_joint_fit(self) -> list[Experiment]:
        """The experiments of the joint fit."""
        left_out = {f.run for f in self.findings if f.kind.excludes}
        return [e for e in self.experiments.values() if e.name not in left_out]

    def of_run(self, name: str) -> list[Finding]:
        """Return the findings of an experiment, and those of all with a cause in it."""
        names = {name, *(run for run, owner in self._owners.items() if owner == name)}
        return [f for f in self.findings if names & {f.run, *(cause.run for cause in f.causes)}]

    @property
    def of_joint(self) -> list[Finding]:
        """The findings of all and of the experiments in the joint fit, and who is left out of it, and why."""
        owners, names = self._owners, {"", *(e.name for e in self.in_joint_fit)}
        findings = [f for f in self.findings if owners.get(f.run, f.run) in names]
        findings += [f for f in self.findings if f.kind.excludes and not f.kind.unsound]
        faulty = self.faulty.difference(self.settings.exclude)
        left_out = [name for name in dict.fromkeys(f.run for f in self.findings) if name in faulty]
        for name in left_out:
            causes = tuple(f for f in self.findings if f.run == name and f.kind.excludes and f.kind.unsound)
            message = f"left out of the joint fit: {joint_message(causes[:MAX_NAMED])}"
            findings.append(Finding("rejected", message, name, causes=causes))
        total = len(left_out) + len(self.in_joint_fit)
        if len(left_out) > max(1, MAX_LEFT_OUT * total):
            message = (
                f"{len(left_out)} of {total} experiments, more than a third, are left out "
                f"({', '.join(left_out)}): the others may agree by chance or have a fault in common; the "
                "uncertainties are not valid"
            )
            findings.append(Finding("too_many_exclusions", message))
        return findings

    @property
    def _owners(self) -> dict[str, str]:
        """Names of the experiments by the names of their runs."""
        return {run.telemetry.run: e.name for e in self.experiments.values() for run in e.runs}

    def find_each(
        self,
        find: Callable[[Experiment], Iterable[Finding]],
        experiments: Iterable[Experiment] | None = None,
    ) -> list[Finding]:
        """Return what a function finds in each of some experiments, in those without a fault by default."""
        every = self.usable if experiments is None else [*experiments]
        return [*chain.from_iterable(parallel_map(lambda e: [*find(e)], every, Experiment.samples))]

    def decide(self, findings: Iterable[Finding]) -> "Campaign":
        """Return the campaign with findings, and what follows from them by the table of kinds.

        A run with a finding of a kind that excludes is left out of the joint fit; what more experiments have
        than the kind admits is not theirs alone, and becomes one finding of all. What is found in a span is
        masked; an experiment with a finding of a kind that adapts its fit is fitted anew.

        Raises
        ------
        InputError
            If faults leave no experiment for the joint fit.
        """
        owners, members = self._owners, {e.name for e in self.candidates}
        by_code: dict[str, list[Finding]] = {}
        for finding in sorted(findings, key=lambda finding: finding.code in LATER):
            run = owners.get(finding.run, finding.run) if finding.kind.excludes else finding.run
            by_code.setdefault(finding.code, []).append(replace(finding, run=run))
        decided: list[Finding] = []
        for code, of_code in by_code.items():
            share, n = KINDS[code].excludes, len({finding.run for finding in of_code} & members)
            if not share or (n <= max(1, share * len(members)) and (n < len(members) or share > 1)):
                decided += of_code
            else:
                causes = joint_message(of_code)
                is_common = len(members) > 1
                message = f"most of the experiments have a fault in common: {causes}" if is_common else causes
                decided.append(Finding(code, message, causes=tuple(of_code)))
        adapted = self._adapted([finding for of_code in by_code.values() for finding in of_code])
        fits = {name: fit for name, fit in self.fits.items() if adapted[name] is self.experiments[name]}
        campaign = replace(self, experiments=adapted, findings=(*self.findings, *decided), fits=fits)
        if self.in_joint_fit and not campaign.in_joint_fit and campaign.faulty - self.faulty:
            raise InputError(joint_message(f for f in campaign.findings if f.run in campaign.faulty))
        return campaign

    def _adapted(self, findings: Iterable[Finding]) -> dict[str, Experiment]:
        """Return the experiments with what findings mask, and as findings have them fitted."""
        experiments, owners = dict(self.experiments), self._owners
        for finding in findings:
            if not (finding.spans or finding.kind.adapts):
                continue
            e = experiments[owners.get(finding.run, finding.run)]
            if finding.kind.adapts == "marginalised":
                e = replace(e, marginalised=True)
            elif finding.kind.adapts == "readout_excess":
                e = replace(e, readout_excess=True)
            elif finding.run == e.sysid.telemetry.run:
                e = replace(e, sysid=e.sysid.mask(finding.spans))
            elif e.noise:
                e = replace(e, noise=e.noise.mask(finding.spans))
            experiments[e.name] = e
        return experiments

    def fit_each(self) -> "Campaign":
        """Return the campaign with the fit of each experiment by itself, of those that have none yet."""
        experiments = [e for e in self.experiments.values() if e.name not in self.fits]
        fits = parallel_map(lambda e: fit_single(e, self.settings), experiments, Experiment.samples)
        of_new = {e.name: fit for e, fit in zip(experiments, fits, strict=True)}
        return replace(self, fits={**self.fits, **of_new})


def fit_single(
    e: Experiment, settings: Settings, initial: IRLSResult | FitError | None = None
) -> IRLSResult | FitError:
    """Return the fit of an experiment by itself, or why there is none: that must not cost the others."""
    try:
        return fit_experiment(e, settings.estimator, initial, settings.parameters)
    except FitError as error:
        return error
    except InputError as error:  # too few samples are left of it
        return FitError(str(error))


def participation(experiments: Sequence[Experiment], settings: Settings) -> list[Finding]:
    """Return which experiments do not take part in the joint fit by the settings, or being too short.

    Raises
    ------
    InputError
        If an experiment that the settings exclude is not there.
    """
    _, short, excluded = divide(experiments, settings)
    return [
        Finding(code, f"left out of the joint fit, {why}: {e.sysid.telemetry.run}", e.name)
        for code, why, members in (
            ("short_run", "being shorter than 6 h", short),
            ("excluded", "named in exclude", excluded),
        )
        for e in members
    ]
