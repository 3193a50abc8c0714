"""Parameters of a simulated loop, estimated from telemetry with the weighing and the iteration of the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.consistency import consistency_warnings
from fit.crosstalk import attenuation, refit
from fit.errors import InputError
from fit.fitting import constraint_test, irls, width_posterior
from fit.identification import comparison
from fit.identification.loop import FreeParameter, Loop, joint_parameters
from fit.identification.parameters import (
    check_constraints,
    joint,
    run_dynamics,
    with_params,
    without_constraints,
)
from fit.identification.search import Search
from fit.model import Sharing
from fit.parallel import one_blas_thread
from fit.quality import fit_quality, noise_adaptation
from fit.results import Estimate, Fit, Provenance, Results
from fit.settings import Settings
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
        Values in the loop of parameters of the fit that are not identified.
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
        If the loop cannot be simulated, or no valid estimate results.
    """
    identification = _Identification(
        experiments, free, loop, calibrated, _constrained(experiments, free, calibrated, settings, params)
    )
    return identification.results(fixed_values)


def _constrained(
    experiments: Sequence[Experiment],
    free: Sequence[FreeParameter],
    calibrated: Results,
    settings: Settings,
    params: lmfit.Parameters | None,
) -> Settings:
    """Return the settings with all constraints of identified parameters.

    Raises
    ------
    InputError
        If one is of no parameter.
    """
    names = [*joint_parameters(free, [e.sysid.telemetry for e in experiments])]
    constrained = settings if params is None else with_params(settings, params, names)
    check_constraints(constrained, names, calibrated)
    return constrained


@dataclass(frozen=True)
class _Identification:
    """What is identified, and from what; attributes as the arguments of `identify`."""

    experiments: Sequence[Experiment]
    free: Sequence[FreeParameter]
    loop: Loop
    calibrated: Results
    settings: Settings

    def results(self, fixed_values: Mapping[str, float]) -> Results:
        """Estimate the parameters, and compare them with the fit of the equation."""
        experiments, calibrated, settings = self.experiments, self.calibrated, self.settings
        unconstrained = replace(self, settings=without_constraints(settings))
        # data are judged without what the user says of parameters, which may be wrong
        search, judged, levels = unconstrained._search()
        outcome = judged
        if unconstrained.settings != settings:
            search, outcome = self._search_with([e.name in levels for e in experiments])
        if outcome.random_effects:
            outcome = replace(
                width_posterior.marginalise_widths(outcome), data_driven=settings.scatter == ["auto"]
            )
        joint_fit = self._with_instruments(self._report(outcome))
        commands = comparison.command_mismatches(experiments, self.loop, search.joint, outcome)
        constraints = constraint_test.refit_unconstrained(outcome, settings.parameters)
        bounded = {c.name for c in constraints.at_bound}  # the test of the constraints reports these
        runs = [e.sysid.telemetry for e in experiments] if not outcome.random_effects else []
        context = comparison.LoopContext(fixed_values, runs, Sharing(settings.shared))
        discrepancies = comparison.discrepancies(
            joint_fit, calibrated, context, bounded, same_loop=self.loop.simulated_telemetry
        )
        if constraints.is_contradicted:  # of which they are a consequence
            discrepancies = []
        warnings = [
            *comparison.data_warnings(calibrated),
            *consistency_warnings(experiments, judged),
            *noise_adaptation.misfits(experiments, judged),
            *comparison.command_warnings(commands, list(joint_fit)),
            *search.warnings(),
            *map(noise_adaptation.marginalised_warning, levels),
            *discrepancies,
            *comparison.fixed_value_conflicts(fixed_values, calibrated.joint),
        ]
        entries = {
            "from_fit": comparison.differences(joint_fit, calibrated.joint),
            "commands": {run: command.mismatch for run, command in commands.items()},
        }
        joint_fit = replace(joint_fit, warnings=(*constraints.warnings(), *joint_fit.warnings, *warnings))
        return Results(joint_fit, {}, {}, {}, self._provenance(outcome, entries, levels))

    def _begin(self, levels: Sequence[bool], previous: Mapping[str, float]) -> Search:
        """Begin where the fit or the `previous` search ended, with the random effects of the fit."""
        calibrated, settings = self.calibrated, self.settings
        if settings.estimator == "flscov":
            raise InputError(
                'fit.estimator: "flscov" is not available with a simulated loop, expected another estimator'
            )
        references = [run_dynamics(e, calibrated, settings) for e in self.experiments]
        values = calibrated.joint.values if calibrated.joint else {}
        scatter = [*(calibrated.provenance.scatter or {})]  # stated, or the data ask for them
        parameters = joint(self.experiments, self.free, settings, scatter, (previous, values))
        return Search(self.experiments, self.loop, references, parameters, settings.estimator, levels)

    def _search(self) -> tuple[Search, irls.IRLSResult, list[str]]:
        """Search; return also the experiments whose noise levels are marginalised.

        Where the data chose them in the fit, the equation may only have lacked what the loop has: they are
        marginalised if the loop leaves too much as well.
        """
        experiments, by_data = self.experiments, self.settings.levels == ["auto"]
        levels = [e.marginalised and not by_data for e in experiments]
        search, outcome = self._search_with(levels)
        if by_data and any(e.marginalised for e in experiments):
            misfits = noise_adaptation.misfit_ratios(experiments, outcome)
            levels = [e.marginalised and e.name in misfits for e in experiments]
            if any(levels):
                search, outcome = self._search_with(levels)
        names = [e.name for e, is_marginalised in zip(experiments, levels, strict=True) if is_marginalised]
        return search, outcome, names

    def _search_with(self, levels: Sequence[bool]) -> tuple[Search, irls.IRLSResult]:
        """Search, and once more if the controller has moved from where forces were computed from motions."""
        search = self._begin(levels, {})
        outcome = search.outcome()
        if not search.has_strayed(outcome.solution.theta):
            return search, outcome
        restarted = self._begin(levels, search.joint.named(outcome.solution.theta))
        restarted.halved_steps = search.halved_steps
        return restarted, restarted.outcome()

    def _report(self, outcome: irls.IRLSResult) -> Fit:
        """Return the free parameters that are determined, and why the others are not."""
        experiments = self.experiments
        free_parameters = joint_parameters(self.free, [e.sysid.telemetry for e in experiments])
        names = {p.name: p.name for p in outcome.parameters if p.name in free_parameters}
        undetermined = fit_quality.indeterminable(outcome, experiments, names)
        doubts = [*fit_quality.doubts(outcome, experiments), *fit_quality.scattered(outcome)]
        fit = fit_quality.report(outcome, experiments, names, [*undetermined, *doubts])
        return replace(fit, parameters={n: self._stated(n, e) for n, e in fit.parameters.items()})

    def _stated(self, name: str, estimate: Estimate) -> Estimate:
        """Return an estimate without the physical limits of its parameter, where it is not at one."""
        constraint = estimate.constraint
        is_stated = name in self.settings.parameters or (constraint and constraint.at_bound)
        return estimate if is_stated else replace(estimate, constraint=None)

    def _with_instruments(self, joint_fit: Fit) -> Fit:
        """Return an identification with what instrumental variables change in the fit of the equation.

        The loop takes its cross-talk from the same noisy read-outs and has no instruments, so that the same
        attenuation shifts both.
        """
        fitted = self.calibrated.joint
        names = [name for name in joint_fit.parameters if name in attenuation.iv_parameters(fitted)]
        if fitted is None or not names:
            return joint_fit
        least_squares = refit.least_squares(self.experiments, self.settings, self.calibrated)
        corrections = attenuation.iv_corrections({name: fitted[name] for name in names}, least_squares)
        missing = ", ".join(name for name in joint_fit.parameters if name not in fitted.parameters)
        note = f"; by how much it is for {missing} is not known" if missing else ""
        description = "corrected and widened as by the instrumental variables of the fit"
        return attenuation.apply_iv(joint_fit, corrections, description, note)

    def _provenance(
        self, outcome: irls.IRLSResult, entries: Mapping[str, object], levels: list[str]
    ) -> Provenance:
        """Return that of the calibration without what an identification has not."""
        provenance = self.calibrated.provenance
        absent = dict.fromkeys(("cross_talk_periods", "subtraction", "inertial_runs", "inertial_band"))
        widths = {name: {"value": value, "sigma": sigma} for name, (value, sigma) in outcome.scatter.items()}
        extra = {**provenance.extra, **entries}
        return replace(
            provenance,
            settings=self.settings.record(),
            extra=extra,
            levels=levels,
            scatter=widths,
            **absent,
        )
