"""The experiments of a calibration, what is found of them, and the decision on what follows from that."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from fit.errors import InputError
from fit.findings import KINDS, Finding, joint_message
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
        All that could be masked, by name.
    findings : tuple of Finding
        What is found; those of a run have the name of its experiment.
    """

    experiments: Mapping[str, Experiment]
    findings: tuple[Finding, ...] = ()

    @property
    def left_out(self) -> set[str]:
        """Names of the experiments that are not in the joint fit."""
        return {finding.run for finding in self.findings if finding.run and finding.kind.excludes}

    @property
    def faulty(self) -> set[str]:
        """Names of those that are not because of a fault."""
        exclusions = (f for f in self.findings if f.run and f.kind.excludes and f.kind.unsound)
        return {finding.run for finding in exclusions}

    @property
    def in_joint_fit(self) -> list[Experiment]:
        """The experiments of the joint fit."""
        left_out = self.left_out
        return [e for e in self.experiments.values() if e.name not in left_out]

    @property
    def usable(self) -> list[Experiment]:
        """Those without a fault, in the joint fit or not."""
        faulty = self.faulty
        return [e for e in self.experiments.values() if e.name not in faulty]

    def of_run(self, name: str) -> list[Finding]:
        """Return the findings of an experiment, and those of all with a cause in it."""
        names = {name, *(run for run, owner in self._owners.items() if owner == name)}
        return [f for f in self.findings if names & {f.run, *(cause.run for cause in f.causes)}]

    @property
    def of_joint(self) -> list[Finding]:
        """The findings of all and of the experiments in the joint fit, and who is left out of it, and why."""
        owners, faulty, excluded = self._owners, self.faulty, self._with_code("excluded")
        names = {"", *(e.name for e in self.in_joint_fit)}
        found = [f for f in self.findings if owners.get(f.run, f.run) in names]
        found += [f for f in self.findings if f.kind.excludes and not f.kind.unsound]
        left_out = [name for name in dict.fromkeys(f.run for f in self.findings) if name in faulty - excluded]
        for name in left_out:
            causes = tuple(f for f in self.findings if f.run == name and f.kind.excludes and f.kind.unsound)
            message = f"left out of the joint fit: {joint_message(causes[:MAX_NAMED])}"
            found.append(Finding("rejected", message, name, causes=causes))
        total = len(left_out) + len(self.in_joint_fit)
        if len(left_out) > max(1, MAX_LEFT_OUT * total):
            message = (
                f"{len(left_out)} of {total} experiments, more than a third, are left out "
                f"({', '.join(left_out)}): the others may agree by chance or have a fault in common; the "
                "uncertainties are not valid"
            )
            found.append(Finding("too_many_exclusions", message))
        return found

    @property
    def _owners(self) -> dict[str, str]:
        """Names of the experiments by the names of their runs."""
        runs = ((e.name, run) for e in self.experiments.values() for run in (e.sysid, e.noise) if run)
        return {run.telemetry.run: name for name, run in runs}

    def _with_code(self, code: str) -> set[str]:
        return {finding.run for finding in self.findings if finding.code == code}

    def decide(self, findings: Iterable[Finding]) -> "Campaign":
        """Return the campaign with findings, and what follows from them by the table of kinds.

        A run with a finding of a kind that excludes is left out of the joint fit. What more experiments have
        than the kind admits is not theirs alone, and becomes one finding of all.

        Raises
        ------
        InputError
            If faults leave no experiment for the joint fit.
        """
        owners, n = self._owners, len(self.usable)
        by_code: dict[str, list[Finding]] = {}
        for finding in sorted(findings, key=lambda finding: finding.code in LATER):
            run = owners.get(finding.run, finding.run) if finding.kind.excludes else finding.run
            by_code.setdefault(finding.code, []).append(replace(finding, run=run))
        decided: list[Finding] = []
        for code, of_code in by_code.items():
            share, names = KINDS[code].excludes, {finding.run for finding in of_code} - {""}
            if not share or (len(names) <= max(1, share * n) and (len(names) < n or share > 1)):
                decided += of_code
            else:
                causes = joint_message(of_code)
                message = f"most of the experiments have a fault in common: {causes}" if n > 1 else causes
                decided.append(Finding(code, message, causes=tuple(of_code)))
        campaign = replace(self, findings=(*self.findings, *decided))
        if self.in_joint_fit and not campaign.in_joint_fit and campaign.faulty - self.faulty:
            raise InputError(joint_message(f for f in campaign.findings if f.run in campaign.faulty))
        return campaign

    def update(self, experiments: Iterable[Experiment]) -> "Campaign":
        """Return the campaign with some experiments as they are to be fitted now."""
        return replace(self, experiments={**self.experiments, **{e.name: e for e in experiments}})


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
