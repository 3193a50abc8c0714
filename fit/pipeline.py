"""From telemetry to results: masks, single fits, joint fit, verdict, cross-talk, inertial forces."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from fit.consistency import (
    equation_warnings,
    explain_findings,
    fit_consistent_runs,
    model_warnings,
)
from fit.crosstalk import attenuation, centrifugal, coupling_constraints, crosstalk_fit, euler_fit
from fit.errors import FitError, InputError
from fit.findings import Finding
from fit.fitting import (
    IRLSResult,
    constraint_test,
    constraints,
    constraints_of,
    fit_experiment,
    fit_joint,
)
from fit.model import Sharing, rotation, separation
from fit.parallel import one_blas_thread, parallel_map, progress_stage
from fit.quality import (
    Campaign,
    drifts,
    fit_quality,
    has_spectra,
    mask_experiments,
    mask_spikes,
    metadata,
    noise_adaptation,
    noise_tests,
    participation,
    unit_faults,
)
from fit.requirements import TAPER
from fit.results import Fit, Provenance, Results, check_frame
from fit.settings import ParameterSettings, Settings, settings, with_other_constraints
from fit.spacecraft import check_same
from fit.telemetry import Telemetry, common_x_axis, inertial_period
from fit.whitening import Experiment, pair


@one_blas_thread
def calibrate(telemetries: Sequence[Telemetry], chosen: Settings | None = None) -> Results:
    """Calibrate the dynamics and, where there are long noise runs with torques, the inertial forces.

    Parameters
    ----------
    telemetries : sequence of Telemetry
        Runs of LISA Pathfinder or of a LISA spacecraft, a sysid run and a noise run for each experiment.
    chosen : Settings, optional
        What the user chose, the default otherwise.

    Raises
    ------
    InputError
        If there is nothing to fit, or if runs state different frames.
    FitError
        If no valid estimate results.
    """
    check_same(telemetries)
    chosen = chosen or settings()
    return _with_inertial(_dynamics(telemetries, chosen), telemetries, chosen.parameters)


@one_blas_thread
def calibrate_inertial(
    telemetries: Sequence[Telemetry],
    calibration: Results,
    parameters: Mapping[str, ParameterSettings] | None = None,
) -> Results:
    """Calibrate the inertial forces alone; everything else is carried over.

    Parameters
    ----------
    telemetries : sequence of Telemetry
        Noise runs of any sample rates.
    calibration : Results
        Of the dynamics, with a joint fit.
    parameters : mapping of str to ParameterSettings, optional

    Raises
    ------
    InputError
        If there is a sysid run, no run with torques, or if frames differ.
    FitError
    """
    for run in telemetries:
        if run.kind == "sysid":
            raise InputError(f"{run.path}: a sysid run, expected noise runs only with an earlier calibration")
        check_frame(calibration, run)
    if not any(map(euler_fit.takes_part, telemetries)):
        raise InputError(
            f"{_paths(telemetries)}: no noise run of {euler_fit.MIN_DURATION / 3600:g} h or more with "
            "torques about phi and eta (N_phi_1, N_eta_1), expected at least one"
        )
    parameters, angles = parameters or {}, euler_fit.names(telemetries)
    constraints.check(parameters, angles, "fit.parameters")
    recorded = with_other_constraints(calibration.provenance.settings, angles, parameters)
    turned = replace(calibration.provenance, x_axis=common_x_axis(telemetries), settings=recorded)
    return _with_inertial(replace(calibration, provenance=turned), telemetries, parameters)


def _paths(telemetries: Sequence[Telemetry]) -> str:
    return ", ".join(str(t.path) for t in telemetries) or "no telemetry"


def _with_inertial(
    results: Results, telemetries: Sequence[Telemetry], parameters: Mapping[str, ParameterSettings]
) -> Results:
    """Fit the inertial periods that the runs belong to, given a joint fit."""
    periods: dict[str, list[Telemetry]] = {}
    for run in filter(euler_fit.takes_part, telemetries):
        periods.setdefault(inertial_period(run), []).append(run)
    if (joint := results.joint) is None or not periods:
        return results

    def fitted(period: str) -> tuple[str, Fit]:
        angles = euler_fit.constraints_of_period(parameters, period)
        return period, _doubted(euler_fit.fit_period(periods[period], joint, angles, len(periods)), joint)

    fits = dict(parallel_map(fitted, periods))
    names = dict(results.provenance.inertial_runs or {})
    names |= {name: [run.run for run in runs] for name, runs in periods.items()}
    provenance = replace(results.provenance, inertial_runs=names, inertial_band=list(euler_fit.BAND))
    inertial, cross_talk = {**results.inertial, **fits}, _separated(results, fits)
    return replace(results, inertial=inertial, cross_talk=cross_talk, provenance=provenance)


def _separated(results: Results, fits: Mapping[str, Fit]) -> dict[str, Fit]:
    """Take the Euler force off the cross-talk of every epoch whose runs lie in one fitted period."""
    separated, d = dict(results.cross_talk), separation(results.provenance.frame)
    for epoch, period in (results.provenance.cross_talk_periods or {}).items():
        if epoch not in separated or period not in fits:
            continue
        fit = separated[epoch]
        if crosstalk_fit.is_separated(fit) and period in results.inertial:  # by an earlier fit of the period
            fit = crosstalk_fit.restore_euler_force(fit, results.inertial[period], d)
        if not crosstalk_fit.is_separated(fit) and not centrifugal.contradicts(fits[period].warnings):
            fit = crosstalk_fit.subtract_euler_force(fit, fits[period], period, d)
        separated[epoch] = fit
    return separated


@dataclass(frozen=True)
class _Together:
    """The joint fit and the statistics of the agreement of its runs."""

    outcome: IRLSResult
    fit: Fit
    agreement: dict[str, dict[str, float]] | None
    correction: attenuation.AttenuationCorrected | None


def _dynamics(telemetries: Sequence[Telemetry], chosen: Settings) -> Results:
    """Fit the experiments, each on its own and jointly, and the cross-talk that was fitted along."""
    progress_stage(0.1)
    of_band = (e.limit_band(chosen.f_max) for e in pair(telemetries))
    recorded = [mask_spikes(e.with_parameters(chosen.parameters)) for e in of_band]
    if not recorded:
        raise InputError(
            f"{_paths(telemetries)}: no run of kind 'sysid', expected at least one to calibrate with, "
            "or an earlier calibration"
        )
    common_x_axis(telemetries)
    campaign = Campaign({e.name: e for e in recorded}).decide(participation(recorded, chosen))
    if chosen.parameters:
        runs = [(e.sysid.telemetry, e.parameters) for e in recorded]
        names = [p.name for p in Sharing(chosen.shared).parameters(runs)]
        constraints.check(chosen.parameters, [*names, *euler_fit.names(telemetries)], "fit.parameters")
    # what the data are like is judged without what the user says of parameters: that may be wrong
    constrained, chosen = chosen, chosen.model_copy(update={"parameters": {}})
    campaign = _prepared(campaign, chosen)
    progress_stage(0.65)
    found, noisy = noise_adaptation.adapt_to_readout_excess(campaign.usable, chosen)
    campaign = campaign.update(noisy).decide(found)
    single_fits = _fit_each([*campaign.experiments.values()], chosen)
    campaign, single_fits = _noises(campaign, single_fits, chosen)
    campaign = campaign.decide(drifts.of_runs(campaign.usable, single_fits))
    progress_stage(0.95)
    campaign, together = _together(campaign, single_fits, chosen, constrained.parameters)
    joint, fits = _judged(campaign, single_fits, together, constrained)
    joint, cross_talk = _cross_talk(campaign, together, joint, chosen)
    return Results(joint, fits, cross_talk, {}, _provenance(campaign, together, constrained))


def _prepared(campaign: Campaign, chosen: Settings) -> Campaign:
    """Mask what the equation does not hold for and decide who takes part in the joint fit."""
    progress_stage(0.25)
    recorded = [*campaign.experiments.values()]
    spectra = parallel_map(has_spectra, recorded, Experiment.samples)
    readable = [e for e, has in zip(recorded, spectra, strict=True) if has]  # the masks refuse the others
    tested = [e for e in readable if e.name not in chosen.exclude]
    campaign = campaign.decide(metadata.find_faults(tested))
    campaign = campaign.decide(chain.from_iterable(unit_faults(e) for e in readable if e not in tested))
    misfit = model_warnings([e for e in tested if e.name not in campaign.faulty])
    if misfit:  # which would pass for glitches, and be masked
        chosen = chosen.model_copy(update={"glitches": False})
    progress_stage(0.45)
    masked, found = mask_experiments(recorded, chosen, campaign.faulty)
    decided = campaign.decide([*misfit, *found])
    return replace(decided, experiments={e.name: e for e in masked})


def _noises(
    campaign: Campaign, single_fits: dict[str, IRLSResult | FitError], chosen: Settings
) -> tuple[Campaign, dict[str, IRLSResult | FitError]]:
    """Judge the noise of every experiment by its own fit; fit anew by itself where it is not as it seemed."""
    every = [*campaign.experiments.values()]
    of_levels = campaign.usable if chosen.levels == ["auto"] else every
    found, noisy = noise_adaptation.adapt_to_levels(of_levels, single_fits, chosen)
    return campaign.update(noisy).decide(found), single_fits | _fit_each(noisy, chosen)


def _fit_each(experiments: Sequence[Experiment], chosen: Settings) -> dict[str, IRLSResult | FitError]:
    fits = parallel_map(lambda e: _fit_single(e, chosen), experiments, Experiment.samples)
    return {e.name: fit for e, fit in zip(experiments, fits, strict=True)}


def _fit_single(
    e: Experiment, chosen: Settings, initial: IRLSResult | FitError | None = None
) -> IRLSResult | FitError:
    """Fit one experiment."""
    try:
        return fit_experiment(e, chosen.estimator, initial, chosen.parameters)
    except FitError as error:
        return error


def _together(
    campaign: Campaign,
    single_fits: Mapping[str, IRLSResult | FitError],
    chosen: Settings,
    parameters: Mapping[str, ParameterSettings],
) -> tuple[Campaign, _Together | None]:
    """Fit jointly what agrees, then with what the user says of parameters."""
    if not campaign.in_joint_fit:
        return campaign, None
    agreed = fit_consistent_runs(campaign.in_joint_fit, single_fits, chosen)
    outcome = agreed.outcome
    if any(setting.is_constraint for setting in parameters.values()):
        constrained = chosen.model_copy(update={"parameters": parameters, "scatter": list(outcome.scatter)})
        try:
            outcome = replace(
                fit_joint(agreed.experiments, constrained, single_fits), data_driven=outcome.data_driven
            )
        except FitError as error:
            names = ", ".join(parameters)
            raise FitError(f"{error}; without the constraints of {names} there is one") from error
    has_couplings = any(e.sysid.channels.means for e in agreed.experiments)
    correction = attenuation.correct_attenuation(outcome, agreed.experiments) if has_couplings else None
    test = coupling_constraints.check_constraints(outcome, agreed.outcome, agreed.experiments, correction)
    contradictions = equation_warnings(agreed.test, agreed.experiments) if agreed.test else ()
    of_runs = [f for f in agreed.findings if f.run or not (contradictions and f.code == "contradiction")]
    campaign = campaign.decide((*contradictions, *of_runs, *drifts.of_joint(agreed.outcome)))
    if agreed.test:
        explained = explain_findings(
            campaign.findings,
            [*campaign.experiments.values()],
            single_fits,
            agreed.outcome,
            agreed.test,
            Sharing(chosen.shared),
        )
        campaign = replace(campaign, findings=explained)
    fit = _warned(fit_quality.as_fit(outcome, agreed.experiments), test.warnings())
    return campaign, _Together(outcome, fit, agreed.statistics, correction)


def _judged(
    campaign: Campaign,
    single_fits: Mapping[str, IRLSResult | FitError],
    together: _Together | None,
    chosen: Settings,
) -> tuple[Fit | None, dict[str, Fit]]:
    """Return the joint fit and those of the experiments, with what keeps them from being trusted."""
    every = [*campaign.experiments.values()]
    single = parallel_map(lambda e: _of_experiment(e, campaign, single_fits[e.name], chosen), every)
    fits = {e.name: fit for e, fit in zip(every, single, strict=True) if isinstance(fit, Fit)}
    failures = [finding for finding in single if isinstance(finding, Finding)]
    if not together:
        if not fits:
            raise FitError("; ".join(failure.message for failure in failures))
        return None, {name: _warned(fit, failures) for name, fit in fits.items()}
    joint = _warned(together.fit, campaign.of_joint)
    # of those that are left out is said what is wrong
    joint = _warned(joint, [f for f in failures if f.run not in campaign.faulty])
    codes = {w.code for w in joint.warnings}
    in_joint = [(e.name, fits[e.name]) for e in campaign.in_joint_fit if e.name in fits]
    if "constraint_contradicted" in codes:
        return joint, fits
    return _warned(joint, [w for w in fit_quality.of_joint(joint, in_joint) if w.code not in codes]), fits


def _of_experiment(
    experiment: Experiment,
    campaign: Campaign,
    single_fit: IRLSResult | FitError,
    chosen: Settings,
) -> Fit | Finding:
    """Return the fit of an experiment by itself, or that there is none."""
    judged = single_fit
    if constraints_of(experiment, chosen.parameters):  # these may be wrong
        single_fit = _fit_single(experiment, chosen, single_fit)
    if isinstance(single_fit, FitError) or isinstance(judged, FitError):
        # what one experiment by itself does not yield must not cost the others
        error = next(e for e in (judged, single_fit) if isinstance(e, FitError))
        return Finding("no_single_fit", str(error), experiment.name)
    fit = fit_quality.as_fit(single_fit, [experiment])
    of_data = fit if judged is single_fit else fit_quality.as_fit(judged, [experiment])
    warnings = (
        *campaign.of_run(experiment.name),
        *(fit_quality.of_experiment(experiment.name, of_data) if experiment.noise else ()),
        *constraint_test.refit_unconstrained(single_fit, reference=judged).warnings(),
    )
    diagnostics = noise_tests.diagnose(experiment, single_fit)
    return _warned(replace(fit, diagnostics=diagnostics), warnings)


def _cross_talk(
    campaign: Campaign, together: _Together | None, judged: Fit | None, chosen: Settings
) -> tuple[Fit | None, dict[str, Fit]]:
    """Return the joint fit and the cross-talk of every epoch; where runs turn, that holds the Euler force."""
    if not (together and judged and together.correction):
        return judged, {}
    correction = together.correction
    joint = attenuation.correct_joint(judged, together.outcome, correction)
    couplings = crosstalk_fit.cross_talk(
        together.outcome, campaign.in_joint_fit, Sharing(chosen.shared), correction
    )
    if any(rotation.sources(e.sysid.telemetry) for e in campaign.in_joint_fit):
        couplings = {epoch: crosstalk_fit.with_euler_warning(fit) for epoch, fit in couplings.items()}
    for epoch, fit in couplings.items():
        couplings[epoch] = _warned(fit, coupling_constraints.constraint_warnings(judged, epoch))
    return joint, {epoch: _doubted(fit, judged) for epoch, fit in couplings.items()}


def _warned(fit: Fit, warnings: Iterable[Finding]) -> Fit:
    return replace(fit, warnings=(*fit.warnings, *warnings))


def _doubted(fit: Fit, joint: Fit | None) -> Fit:
    """Return a fit that depends on the joint fit, with the warnings that make the joint fit unsound."""
    return _warned(fit, joint.unsound if joint else ())


def _provenance(campaign: Campaign, together: _Together | None, chosen: Settings) -> Provenance:
    every, periods = [*campaign.experiments.values()], dict[str, set[str]]()
    for run in (e.sysid.telemetry for e in campaign.in_joint_fit):
        periods.setdefault(str(run.alignment_epoch), set()).add(inertial_period(run))
    scatter = together.outcome.scatter if together else {}
    agreement = {"agreement": together.agreement} if together and together.agreement else {}
    subtraction = (
        crosstalk_fit.subtraction(together.outcome, campaign.in_joint_fit, Sharing(chosen.shared))
        if together
        else {}
    )
    return Provenance(
        joint_runs=[e.sysid.telemetry.run for e in campaign.in_joint_fit],
        noise_runs={
            e.sysid.telemetry.run: e.noise.telemetry.run for e in campaign.experiments.values() if e.noise
        },
        f_max=chosen.f_max,
        window=f"Tukey {TAPER:g}",
        cross_talk_periods={epoch: next(iter(names)) for epoch, names in periods.items() if len(names) == 1},
        subtraction=subtraction or None,
        settings=chosen.record(),
        extra={**agreement},
        levels=[e.name for e in campaign.in_joint_fit if e.marginalised],
        x_axis=every[0].sysid.telemetry.x_axis,
        scatter={name: {"value": s, "sigma": sigma} for name, (s, sigma) in scatter.items()},
    )
