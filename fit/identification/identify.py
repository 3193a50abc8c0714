"""Parameters of a simulated loop, estimated from telemetry with the weighing and the iteration of the fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.consistency import consistency_warnings
from fit.crosstalk import refit
from fit.errors import InputError
from fit.fitting import constraint_test, departures, irls
from fit.identification import comparison
from fit.identification.loop import FreeParameter, Loop, joint_parameters
from fit.identification.parameters import check_constraints, joint, run_dynamics, with_params
from fit.identification.search import Search
from fit.model import Sharing
from fit.parallel import one_blas_thread
from fit.quality import fit_quality, noise_adaptation
from fit.results import Fit, Provenance, Results
from fit.settings import Settings
from fit.warnings import FitWarning
from fit.whitening import Experiment

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]


@one_blas_thread
def identify(
    experiments: Sequence[Experiment],
    free: Sequence[FreeParameter],
    loop: Loop,
    calibrated: Results,
    settings: Settings,
    fixed_values: Mapping[str, float] = MappingProxyType({}),
    params: lmfit.Parameters | None = None,
) -> Results:
    """Estimate parameters of a simulated loop.

    Parameters
    ----------
    experiments : sequence of Experiment
    free : sequence of FreeParameter
    loop : Loop
    calibrated : Results
        Of the same telemetry, by the equation of motion.
    settings : Settings
        Of the fit; constraints of parameters hold here too.
    fixed_values : mapping of str to float
        What the loop has of the parameters of the fit that are not sought.
    params : lmfit.Parameters, optional
        Constraints in addition to those of the settings, see `make_params`.

    Returns
    -------
    Results
        With a joint fit alone; see `comparison` for ``from_fit`` and ``commands`` of its provenance.

    Raises
    ------
    InputError
        If the estimator has no counterpart here, a constraint has no parameter, or a start no loop.
    FitError
        If the loop cannot be simulated, or no trustworthy estimate comes out.
    """
    settings = _constrained(experiments, free, calibrated, settings, params)
    begin = partial(_begin_search, experiments, free, loop, calibrated, settings)
    search, outcome, levels = _run_search(begin, experiments, settings)
    outcome, noise_warnings = noise_adaptation.with_segment_variances(outcome, experiments)
    outcome = _integrated(outcome, settings)
    joint_fit = _with_instruments(_report(outcome, experiments, free), experiments, calibrated, settings)
    commands = search.commands(experiments, loop, outcome)
    constraints = constraint_test.refit_unconstrained(outcome, settings.parameters)
    context = _loop_context(experiments, outcome, fixed_values, settings)
    warnings = [
        *comparison.data_warnings(calibrated),
        *consistency_warnings(experiments, outcome),
        *noise_adaptation.misfits(experiments, outcome),
        *comparison.command_warnings(commands, list(joint_fit)),
        *noise_warnings,
        *search.warnings(),
        *constraints.warnings(),
        *map(noise_adaptation.marginalised_warning, levels),
        *_discrepancies(joint_fit, calibrated, context, loop, constraints),
    ]
    joint_fit = replace(joint_fit, warnings=(*joint_fit.warnings, *warnings))
    entries = _provenance_entries(joint_fit, calibrated, commands)
    return Results(joint_fit, {}, {}, {}, _provenance(calibrated, outcome, entries, levels))


def _constrained(
    experiments: Sequence[Experiment],
    free: Sequence[FreeParameter],
    calibrated: Results,
    settings: Settings,
    params: lmfit.Parameters | None,
) -> Settings:
    """Return the settings with all constraints of identified parameters."""
    names = [*joint_parameters(free, [e.sysid.telemetry for e in experiments])]
    constrained = settings if params is None else with_params(settings, params, names)
    check_constraints(constrained, names, calibrated)
    return constrained


def _integrated(outcome: irls.IRLSResult, settings: Settings) -> irls.IRLSResult:
    """Return the outcome with the widths of departures, if there are any, integrated over."""
    if not outcome.random_effects:
        return outcome
    return replace(departures.marginalise_widths(outcome), data_driven=settings.scatter == ["auto"])


def _provenance_entries(
    joint_fit: Fit,
    calibrated: Results,
    commands: Mapping[str, comparison.CommandMismatch],
) -> dict[str, object]:
    """Return what the provenance has of an identification alone."""
    return {
        "from_fit": comparison.differences(joint_fit, calibrated.joint),
        "commands": {run: run_parameters.mismatch for run, run_parameters in commands.items()},
    }


def _begin_search(
    experiments: Sequence[Experiment],
    free: Sequence[FreeParameter],
    loop: Loop,
    calibrated: Results,
    settings: Settings,
    levels: Sequence[bool],
    previous: Mapping[str, float],
) -> Search:
    """Begin where the fit or the `previous` search ended, with the random effects of the fit."""
    if settings.estimator == "flscov":
        raise InputError('fit.estimator: "flscov" takes no simulated loop, expected another estimator')
    references = [run_dynamics(e, calibrated, settings) for e in experiments]
    values = calibrated.joint.values if calibrated.joint else {}
    scatter = [*(calibrated.provenance.scatter or {})]  # as the settings say, or the data asked for
    parameters = joint(experiments, free, settings, scatter, (previous, values))
    return Search(experiments, loop, references, parameters, settings.estimator, levels)


def _report(
    outcome: irls.IRLSResult, experiments: Sequence[Experiment], free: Sequence[FreeParameter]
) -> Fit:
    """Return what is determined of what was sought, and why the rest is not."""
    free_parameters = joint_parameters(free, [e.sysid.telemetry for e in experiments])
    names = {p.name: p.name for p in outcome.parameters if p.name in free_parameters}
    undetermined = fit_quality.indeterminable(outcome, experiments, names)
    doubts = [*fit_quality.doubts(outcome, experiments), *fit_quality.scattered(outcome)]
    return fit_quality.report(outcome, experiments, names, [*undetermined, *doubts])


def _loop_context(
    experiments: Sequence[Experiment],
    outcome: irls.IRLSResult,
    fixed_values: Mapping[str, float],
    settings: Settings,
) -> comparison.LoopContext:
    """Return what the loop has beside the estimates."""
    runs = [e.sysid.telemetry for e in experiments] if not outcome.random_effects else []
    return comparison.LoopContext(fixed_values, runs, Sharing(settings.shared))


def _discrepancies(
    joint_fit: Fit,
    calibrated: Results,
    context: comparison.LoopContext,
    loop: Loop,
    constraints: constraint_test.ConstraintTest,
) -> list[FitWarning]:
    """Warn of differences from the fit; telemetry that contradicts the constraints is of another loop."""
    same_loop = loop.simulated_telemetry and not constraints.is_contradicted
    bounded = {c.name for c in constraints.at_bound}  # the test of the constraints reports these
    return [
        *comparison.discrepancies(joint_fit, calibrated, context, bounded, same_loop=same_loop),
        *comparison.fixed_value_conflicts(context.fixed_values, calibrated.joint),
    ]


def _with_instruments(
    joint_fit: Fit, experiments: Sequence[Experiment], calibrated: Results, settings: Settings
) -> Fit:
    """Return what was found with what instruments move in the fit moved likewise."""
    iv_names = refit.iv_corrected_parameters(calibrated)
    if calibrated.joint is None or not iv_names & set(joint_fit):
        return joint_fit
    least_squares = refit.least_squares(experiments, settings)
    return comparison.apply_instrumental_variables(joint_fit, calibrated.joint, iv_names, least_squares)


def _run_search(
    begin: Callable[[Sequence[bool], Mapping[str, float]], Search],
    experiments: Sequence[Experiment],
    settings: Settings,
) -> tuple[Search, irls.IRLSResult, list[str]]:
    """Search; return also the experiments whose noise levels are marginalised.

    Where the data chose them in the fit, the equation may only have lacked what the loop has: they are
    marginalised if the loop leaves too much as well.
    """
    marginalised = [e.marginalised for e in experiments]
    by_data = settings.levels == ["auto"]

    def run_search(levels: Sequence[bool]) -> tuple[Search, irls.IRLSResult]:
        search = begin(levels, {})
        outcome = search.outcome()
        if search.has_strayed(outcome.solution.theta):
            restarted = begin(levels, search.joint.named(outcome.solution.theta))
            restarted.halved_steps = search.halved_steps
            search, outcome = restarted, restarted.outcome()
        return search, outcome

    search, outcome = run_search([is_marginalised and not by_data for is_marginalised in marginalised])
    if by_data and any(marginalised):
        misfits = noise_adaptation.misfit_ratios(experiments, outcome)
        marginalised = [e.marginalised and e.name in misfits for e in experiments]
        if any(marginalised):
            search, outcome = run_search(marginalised)
    return (
        search,
        outcome,
        [e.name for e, is_marginalised in zip(experiments, marginalised, strict=True) if is_marginalised],
    )


def _provenance(
    calibrated: Results, outcome: irls.IRLSResult, entries: Mapping[str, object], levels: list[str]
) -> Provenance:
    """Return that of the calibration without what an identification has not."""
    provenance = calibrated.provenance
    absent = dict.fromkeys(("cross_talk_periods", "subtraction", "inertial_runs", "inertial_band"))
    widths = {name: {"value": value, "sigma": sigma} for name, (value, sigma) in outcome.scatter.items()}
    return replace(provenance, more={**provenance.more, **entries}, levels=levels, scatter=widths, **absent)
