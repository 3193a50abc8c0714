"""The joint fit of stored results, repeated: its telemetry, and all of the fit that JSON does not hold."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fit import results as fit_results
from fit.campaign import Campaign
from fit.checks import checked
from fit.errors import InputError
from fit.fitting import IRLSResult, fit_joint
from fit.parallel import one_blas_thread
from fit.results import Results, results_file, telemetry_of
from fit.settings import Settings, settings
from fit.telemetry import Telemetry, read_all
from fit.whitening import Experiment, Run


def load(directory: Path) -> tuple[Results, list[Telemetry]]:
    """Read the results in `directory` and the telemetry they are of.

    Raises
    ------
    InputError
        If a file is missing or breaks its contract.
    """
    path = results_file(directory)
    if path == directory:
        raise InputError(f"{path}: is a file, expected the folder of an earlier run or fit")
    results = fit_results.load(path)
    if results.ttl:  # of Michelson variables, which the results hold
        return results, []
    return results, read_all(telemetry_of(results, path))


@one_blas_thread
def experiments(
    results: Results, telemetries: Sequence[Telemetry], path: Path
) -> tuple[list[Experiment], Settings]:
    """Return the experiments of the joint fit of `results`, prepared as they were for it, and its settings.

    Raises
    ------
    InputError
        If the results do not say how they came about.
    """
    if results.joint is None or not results.joint.parameters:
        raise InputError(f"{path}: joint: expected a joint fit that determined parameters")
    runs = {t.run: t for t in telemetries}
    provenance = results.provenance
    joint, pairs, chosen = provenance.joint_runs, provenance.noise_runs, provenance.settings
    if joint is None or pairs is None or chosen is None:
        raise InputError(f"{path}: provenance: expected joint_runs, noise_runs and settings; fit again")
    for name in (*joint, *pairs.values()):
        if name not in runs:
            raise InputError(f"{path}: provenance: run {name!r} is in none of the telemetry files it names")
    recorded = [
        Experiment(Run(runs[name]), Run(runs[pairs[name]]) if name in pairs else None) for name in joint
    ]
    fit_settings = settings(chosen, f"{path}: provenance.settings")
    limited = [e.limit_band(fit_settings.f_max).with_parameters(fit_settings.parameters) for e in recorded]
    campaign = Campaign({e.name: e for e in limited}, fit_settings)
    prepared = checked(campaign, "samples", "gaps", "limits", "residual", "o_1")
    levels = provenance.levels or []
    every = prepared.experiments.values()
    return [replace(e, marginalised=e.name in levels) for e in every], fit_settings


def least_squares(prepared: Sequence[Experiment], settings_of_fit: Settings, results: Results) -> IRLSResult:
    """Return the joint fit of `experiments`, before instruments move anything.

    What the data let scatter in `results` scatters here too.

    Raises
    ------
    FitError
        If no valid estimate results.
    """
    by_data = settings_of_fit.scatter == ["auto"]
    scatter = [*(results.provenance.scatter or {})] if by_data else settings_of_fit.scatter
    constrained = settings_of_fit.model_copy(update={"scatter": scatter})
    unconstrained = constrained.model_copy(update={"parameters": {}})
    outcome = fit_joint(prepared, unconstrained)
    if any(constraint.is_constraint for constraint in constrained.parameters.values()):
        outcome = fit_joint(prepared, constrained)
    return replace(outcome, data_driven=by_data and bool(scatter))
