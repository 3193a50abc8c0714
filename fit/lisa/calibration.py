"""From telemetry of one LISA spacecraft to results: each experiment by itself, and all of them jointly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fit.errors import FitError, InputError
from fit.fitting import IRLSResult, constraint_test, constraints, iterate, user_params
from fit.lisa import attenuation, plausibility
from fit.lisa.experiment import ComponentWeighing, LisaExperiment, pair
from fit.model import lisa_dynamics
from fit.parallel import one_blas_thread
from fit.parameters import LISA
from fit.quality import fit_quality, indeterminable, report
from fit.requirements import TAPER
from fit.results import Fit, Provenance, Results
from fit.settings import Settings, settings
from fit.telemetry import Telemetry
from fit.warnings import FitWarning

if TYPE_CHECKING:
    import lmfit

PARAMETERS = "fit.parameters"
#: Settings of the fit of LISA Pathfinder that have no counterpart here.
_WITHOUT_MEANING = ("scatter", "levels", "shared", "glitches", "include_short")


def is_lisa(telemetries: Sequence[Telemetry]) -> bool:
    """Return whether runs are of a LISA spacecraft.

    Raises
    ------
    InputError
        If some are, and others are of LISA Pathfinder.
    """
    kinds = {run.spacecraft: run for run in telemetries}
    if len(kinds) > 1:
        (name, run), (other_name, other_run) = sorted(kinds.items())
        raise InputError(
            f"{run.path}: telemetry of {name}, but {other_run.path} is of {other_name}; expected one of the "
            "two in a fit"
        )
    return "LISA" in kinds


@one_blas_thread
def calibrate_lisa(
    telemetries: Sequence[Telemetry], chosen: Settings, names: Sequence[str] | None = None
) -> Results:
    """Calibrate one spacecraft by the difference D of its test masses.

    Parameters
    ----------
    telemetries : sequence of Telemetry
        A run with injections and a noise run for each experiment.
    chosen : Settings
        What the user chose.
    names : sequence of str, optional
        Parameters to fit, by default those of the runs without `lisa_dynamics.GEOMETRY`.

    Raises
    ------
    InputError
        If there is nothing to fit, a channel is in another unit, or a setting has no meaning for LISA.
    FitError
        If no valid estimate results.
    """
    check_settings(chosen)
    for run in telemetries:
        plausibility.check_levels(run)
    experiments = _taking_part(pair(telemetries, chosen.f_max), chosen, telemetries)
    used = fitted_names(experiments) if names is None else tuple(names)
    constraints.check(chosen.parameters, used, PARAMETERS)
    joint = fit(experiments, chosen, used)
    if len(experiments) == 1:
        return Results(joint, {experiments[0].name: joint}, {}, {}, _provenance(experiments, chosen))
    single, failures = _fit_each(experiments, chosen, used)
    if not joint.unsound:
        failures += fit_quality.of_joint(joint, single.items())
    joint = replace(joint, warnings=(*joint.warnings, *failures))
    return Results(joint, single, {}, {}, _provenance(experiments, chosen))


def _fit_each(
    experiments: Sequence[LisaExperiment], chosen: Settings, names: Sequence[str]
) -> tuple[dict[str, Fit], list[FitWarning]]:
    """Return the fit of each experiment by itself, and a warning for each that has none."""
    fits: dict[str, Fit] = {}
    failures = []
    for experiment in experiments:
        try:
            fits[experiment.name] = fit([experiment], chosen, names)
        except FitError as error:  # what one experiment does not yield must not cost the others
            failures.append(FitWarning("no_single_fit", (), str(error)))
    return fits, failures


def fitted_names(experiments: Sequence[LisaExperiment]) -> tuple[str, ...]:
    """Return the names of the parameters of all runs, in the order of the runs."""
    return tuple(dict.fromkeys(name for e in experiments for name in e.sysid.channels.parameters))


def make_lisa_params(telemetries: Sequence[Telemetry]) -> lmfit.Parameters:
    """Return the parameters of the joint fit as lmfit has them, at their start values."""
    names = fitted_names(pair(telemetries, settings().f_max))
    if not names:
        raise InputError("make_params: no run of kind 'sysid', expected at least one")
    return user_params.constrained_params([LISA[name] for name in names], {})


def fit(experiments: Sequence[LisaExperiment], chosen: Settings, names: Sequence[str]) -> Fit:
    """Fit experiments together, D_x and D_y of each, for the named parameters, and test their constraints.

    Raises
    ------
    FitError
        If no valid estimate results.
    """
    outcome = solve(experiments, chosen, names)
    estimates = fit_of(outcome, names, experiments)
    warnings = [
        *_test_constraints(outcome, experiments, chosen, names).warnings(),
        *plausibility.implausible_estimates(outcome),
    ]
    is_single = len(experiments) == 1 and experiments[0].noise
    if is_single and not any(w.kind.unsound for w in warnings):
        warnings += fit_quality.of_experiment(experiments[0].name, estimates)
    return replace(estimates, warnings=(*warnings, *estimates.warnings))


def _test_constraints(
    outcome: IRLSResult, experiments: Sequence[LisaExperiment], chosen: Settings, names: Sequence[str]
) -> constraint_test.ConstraintTest:
    """Test the constraints of a fit, with the noise of the fit without constraints if there is one."""
    if outcome.parameter_set is None or not outcome.parameter_set.constrained.any():
        return constraint_test.ConstraintTest()
    reference = None
    with suppress(FitError):
        reference = solve(experiments, chosen.model_copy(update={"parameters": {}}), names)
    return constraint_test.refit_unconstrained(outcome, reference=reference)


def fit_of(outcome: IRLSResult, names: Sequence[str], experiments: Sequence[LisaExperiment]) -> Fit:
    """Report the named parameters, and what keeps them from being trusted."""
    reported = {name: name for name in names}
    warnings = [
        *indeterminable(outcome, (), reported),
        *fit_quality.without_noise_run(e.name for e in experiments if e.noise is None),
        *fit_quality.of_residual(outcome, len(experiments)),
        *attenuation.notable_corrections(outcome),
    ]
    masked = sum(run.n_masked for e in experiments for run in (e.sysid, e.noise) if run)
    estimates = report(outcome, (), reported, warnings)
    return replace(estimates, masked_samples=masked, solved=outcome.solved)


def solve(experiments: Sequence[LisaExperiment], chosen: Settings, names: Sequence[str]) -> IRLSResult:
    """Return the end of the iteration of a fit.

    Raises
    ------
    FitError
        If it does not settle.
    """
    if chosen.estimator == "flscov":  # see `check_settings`
        raise FitError("flscov is available for LISA Pathfinder only")
    weighings = [
        ComponentWeighing(e, equation, np.eye(len(names)), chosen.estimator)
        for e in experiments
        for equation in lisa_dynamics.equations(e.sysid.channels, names)
    ]
    of_fit = constraints.of_fit(chosen.parameters, dict(zip(names, names, strict=True)))
    try:
        return iterate(weighings, [LISA[name] for name in names], settings=of_fit)
    except FitError as error:
        raise FitError(f"{', '.join(e.name for e in experiments)}: {error}") from error


def check_settings(chosen: Settings) -> None:
    """Refuse settings that have no meaning for LISA."""
    default = settings()
    changed = [name for name in _WITHOUT_MEANING if getattr(chosen, name) != getattr(default, name)]
    if chosen.estimator == "flscov":
        changed.append("estimator")
    for name in changed:
        value, expected = getattr(chosen, name), getattr(default, name)
        raise InputError(f"fit.{name}: {value!r} has no meaning for LISA, expected {expected!r}")


def _taking_part(
    experiments: Sequence[LisaExperiment], chosen: Settings, telemetries: Sequence[Telemetry]
) -> list[LisaExperiment]:
    known = [e.name for e in experiments]
    for name in chosen.exclude:
        if name not in known:
            raise InputError(f"fit.exclude: no experiment {name!r}, there are {', '.join(known) or 'none'}")
    taking_part = [e for e in experiments if e.name not in chosen.exclude]
    if not taking_part:
        paths = ", ".join(str(run.path) for run in telemetries)
        raise InputError(f"{paths}: no run of kind 'sysid' to fit, expected at least one")
    return taking_part


def _provenance(experiments: Sequence[LisaExperiment], chosen: Settings) -> Provenance:
    noise_runs: Mapping[str, str] = {
        e.sysid.telemetry.run: e.noise.telemetry.run for e in experiments if e.noise
    }
    return Provenance(
        joint_runs=[e.sysid.telemetry.run for e in experiments],
        noise_runs=dict(noise_runs),
        f_max=chosen.f_max,
        window=f"Tukey {TAPER:g}",
        settings={name: value for name, value in chosen.record().items() if name not in _WITHOUT_MEANING},
    )
