"""What is said where runs of a campaign failed: which, why, and what goes without them."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from fit.results import Fit, FitWarning, Results
from lpfcosim.campaign import Campaign
from lpfcosim.errors import RunError
from lpfcosim.running import Simulated


def divide(plan: Campaign, done: Simulated) -> tuple[list[Path], dict[str, str]]:
    """Return the telemetry of the experiments that are complete, and what is to be told of each other."""
    complete: list[Path] = []
    missing = {}
    for experiment in plan.experiments:
        failed = [str(done.failures[name]) for name in experiment.run_names if name in done.failures]
        if failed:
            missing[experiment.name] = "; ".join(failed)
        else:
            complete += [done.files[name] for name in experiment.run_names]
    return complete, missing


def told(results: Results, missing: Mapping[str, str]) -> Results:
    """Add what is missing to results, where report and readers of the file see it."""
    if not missing:
        return results
    warnings = tuple(
        FitWarning("missing_run", (), f"experiment {name} is missing: {why}") for name, why in missing.items()
    )

    def warned(fit: Fit) -> Fit:
        return replace(fit, warnings=(*warnings, *fit.warnings))

    provenance = {**results.provenance, "missing": dict(missing)}
    if results.joint is not None:
        return replace(results, joint=warned(results.joint), provenance=provenance)
    experiments = {name: warned(fit) for name, fit in results.experiments.items()}
    return replace(results, experiments=experiments, provenance=provenance)


def error(plan: Campaign, done: Simulated, directory: Path) -> RunError:
    """Return what a command says that could not do everything."""
    failed = f"{len(done.failures)} of {len(plan.runs)} runs failed, see {directory / 'logs'}"
    return RunError(f"{failed}: {'; '.join(map(str, done.failures.values()))}")
