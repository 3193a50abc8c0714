"""Parameters of a simulated loop, estimated from telemetry with the weighing and the iteration of the fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fit.agreement import Agreement
from fit.checks import apply, levels, residual
from fit.errors import FitError, InputError
from fit.false_alarms import sigma_limit
from fit.findings import Finding
from fit.fitting import constraint_test, constraints, irls, report, width_posterior
from fit.identification.linearised_run import SimulatedExperiment
from fit.identification.loop import FreeParameter, Loop
from fit.identification.parameters import JointParameters, check_constraints, joint
from fit.parallel import one_blas_thread, parallel_map
from fit.results import Fit, Provenance, Results
from fit.settings import Settings
from fit.statistics import consistency_test
from fit.whitening import Experiment, Likelihood

Array = NDArray[np.float64]

STEP_HALVINGS = 12  # times at most that a step is halved lest the loop be unstable
METHOD_SIGMA = 0.3  # sigma, allowed difference from the fit of the same data; it is some hundredths
#: Codes of warnings about the data as prepared for the fit, which hold for the loop as well.
DATA_CODES = (
    *("saturated", "saturated_too_long", "glitches", "too_many_glitches", "readout_excess_noise", "rejected"),
    *("excluded", "short_run", "missing_run", "suspect_samples", "interpolated", "guidance_scale"),
)


@one_blas_thread
def identify(
    experiments: Sequence[Experiment],
    free: Sequence[FreeParameter],
    loop: Loop,
    calibrated: Results,
    settings: Settings,
    fixed_values: Mapping[str, float] = MappingProxyType({}),
) -> Results:
    """Estimate parameters of a simulated loop; the results have a joint fit alone.

    Parameters
    ----------
    experiments : sequence of Experiment
        As they were prepared for the fit.
    free : sequence of FreeParameter
        The parameters.
    loop : Loop
        Simulates the experiments.
    calibrated : Results
        Of the same telemetry, by the equation of motion.
    settings : Settings
        Of the fit; constraints of parameters hold here too.
    fixed_values : mapping of str to float
        Values in the loop of parameters of the fit that are not identified.

    Raises
    ------
    InputError
        If the estimator has no counterpart here, a constraint has no parameter, or a start no loop.
    FitError
        If the loop cannot be simulated, or no valid estimate results.
    """
    likelihood = _likelihood(settings)
    check_constraints(experiments, free, calibrated, settings)
    parameters = joint(experiments, free, settings, calibrated)
    steps = _Steps(
        [
            SimulatedExperiment(e, loop, parameters, k, "marginalised" if e.marginalised else likelihood)
            for k, e in enumerate(experiments)
        ]
    )
    steps.begin(parameters.start, is_stated=any(p.start is not None for p in free))
    outcome = steps.outcome(parameters)
    if outcome.random_effects:
        widened = width_posterior.marginalise_widths(outcome)
        outcome = replace(widened, data_driven=settings.scatter == ["auto"])
    fit = _report(experiments, parameters, outcome, settings)
    test = constraint_test.refit_unconstrained(outcome, settings.parameters)
    warnings = [
        *test.warnings,
        *fit.warnings,
        *_doubts(experiments, calibrated, outcome),
        *steps.warnings(),
    ]
    if not test.is_contradicted:  # of which a difference is a consequence
        warnings += _differences(fit, calibrated.joint, fixed_values, {*test.active}, loop)
    provenance = _provenance(experiments, calibrated.provenance, outcome, settings)
    return Results(replace(fit, warnings=tuple(warnings)), {}, {}, {}, provenance)


def _likelihood(settings: Settings) -> Likelihood:
    if settings.estimator == "flscov":
        raise InputError(
            'fit.estimator: "flscov" is not available with a simulated loop, expected another estimator'
        )
    return settings.estimator


@dataclass
class _Steps:
    """The steps of the iteration, halved where the loop cannot be simulated; `refusals` says why."""

    weighings: Sequence[SimulatedExperiment]
    refusals: list[str] = field(default_factory=list)

    def begin(self, start: Array, *, is_stated: bool) -> None:
        """Simulate the loop where the search begins; it is wrong input if the user states where."""
        try:
            self._simulate(start)
        except FitError as error:
            kind = InputError if is_stated else FitError
            raise kind(f"identify: start: {error}; expected a loop that can be simulated") from None

    def _simulate(self, theta: Array) -> None:
        parallel_map(lambda weighing: weighing.simulate(theta), self.weighings)

    def outcome(self, parameters: JointParameters) -> irls.IRLSResult:
        """Iterate."""
        return irls.iterate(
            self.weighings,
            parameters.parameters,
            random_effects=parameters.random_effects,
            limit_step=self.limited,
            params=constraints.params(parameters.parameters, parameters.settings),
        )

    def limited(self, theta: Array, target: Array) -> Array:
        """Return the next estimate, shape (P,), with loops that can be simulated."""
        for _ in range(STEP_HALVINGS):
            try:
                self._simulate(target)
            except FitError as error:
                self.refusals.append(str(error))
                target = (theta + target) / 2
            else:
                return target
        raise FitError(f"no step leads on, however short: {self.refusals[-1]}")

    def warnings(self) -> list[Finding]:
        """Report steps that were halved."""
        if not self.refusals:
            return []
        message = (
            f"{len(self.refusals)} steps of the search were halved, the last one because of this: "
            f"{self.refusals[-1]}"
        )
        return [Finding("step_halved", message)]


def _report(
    experiments: Sequence[Experiment],
    parameters: JointParameters,
    outcome: irls.IRLSResult,
    settings: Settings,
) -> Fit:
    """Return the free parameters that are determined, and why the others are not."""
    names = {name: name for name in parameters.free}
    fit = report(outcome, experiments, names, apply("fit", outcome, experiments, names))
    estimates = {  # physical limits of a parameter are no constraint unless it is at one
        name: e if name in settings.parameters or "at bound" in e.constraint else replace(e, constraint="")
        for name, e in fit.parameters.items()
    }
    return replace(fit, parameters=estimates)


def _doubts(
    experiments: Sequence[Experiment], calibrated: Results, outcome: irls.IRLSResult
) -> list[Finding]:
    """Return the warnings about the data, and about what the loop leaves of them."""
    agreed = Agreement(outcome, tuple(experiments), test_of_all=consistency_test(experiments, outcome))
    return [
        *(w for w in (calibrated.joint.warnings if calibrated.joint else ()) if w.code in DATA_CODES),
        *(apply("agreement", agreed) if len(experiments) > 1 else ()),
        *residual.misfits(experiments, outcome),
        *(levels.marginalised(e.name) for e in experiments if e.marginalised),
    ]


def _differences(
    fit: Fit, calibrated: Fit | None, fixed_values: Mapping[str, float], tested: set[str], loop: Loop
) -> list[Finding]:
    """Warn of differences from the fit of the equation that are larger than those of the two methods.

    Both see the same data. Where one has parameters that the other has not, or values that are fixed, their
    sigmas differ, and the variance of the difference is that of the variances (Hausman). If the telemetry
    does not say that this very loop simulated it, the loop may be wrong without any trace in chi2: the
    read-outs determine only the product of the gains of controller and actuation.

    Parameters
    ----------
    fit, calibrated : Fit
        The identification, and the fit; one that is not sound is no reference.
    fixed_values : mapping of str to float
        What the loop has of other parameters of the fit.
    tested : set of str
        Parameters whose constraints have been tested.
    loop : Loop
        The loop.
    """
    if calibrated is None or calibrated.unsound:
        return []
    values = {name: (value, 0.0) for name, value in fixed_values.items()}
    values |= {name: (e.value, e.sigma) for name, e in fit.parameters.items()}
    compared = {
        name: (value, sigma, calibrated[name])
        for name, (value, sigma) in values.items()
        if name in calibrated.parameters and name not in tested and not calibrated[name].is_exact
    }
    limit = sigma_limit(len(compared))
    differing = {
        name: (value - e.value) / e.sigma
        for name, (value, sigma, e) in compared.items()
        if abs(value - e.value) > METHOD_SIGMA * e.sigma + limit * math.sqrt(abs(e.sigma**2 - sigma**2))
    }
    if not differing:
        return []
    listed = ", ".join(f"{name} by {sigmas:+.2g} sigma" for name, sigmas in differing.items())
    message = f"the simulated loop and the equation of motion differ in the same data: {listed}"
    if loop.simulated_telemetry and not differing.keys() & fixed_values.keys():
        return [Finding("loop_discrepancy", message, parameters=tuple(differing))]
    return [
        Finding(
            "loop_contradiction",
            f"{message}; chi2 does not show which of them is wrong",
            parameters=tuple(differing),
        )
    ]


def _provenance(
    experiments: Sequence[Experiment], provenance: Provenance, outcome: irls.IRLSResult, settings: Settings
) -> Provenance:
    """Return that of the calibration without what an identification has not."""
    return replace(
        provenance,
        settings=settings.record(),
        levels=[e.name for e in experiments if e.marginalised],
        scatter={name: {"value": value, "sigma": sigma} for name, (value, sigma) in outcome.scatter.items()},
        cross_talk_periods=None,
        subtraction=None,
        inertial_runs=None,
        inertial_band=None,
    )
