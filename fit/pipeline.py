"""What happens to a run, from telemetry to results.

The runs are paired and checked, stage by stage as in the table of `fit.checks`. What follows from a finding
is decided by its kind, in `Campaign.decide` alone: samples are masked, the fit adapts to noise, the run is
left out, or the user is warned. Each experiment is fitted by itself, and those that agree are fitted jointly,
without what the user says of parameters and then with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from fit.agreement import Agreement, fit_consistent_runs
from fit.campaign import Campaign, fit_single, participation
from fit.checks import apply, as_fit, checked, explain_findings, residual
from fit.crosstalk import attenuation, crosstalk_fit, euler_fit, inertial
from fit.errors import FitError, InputError
from fit.findings import Finding
from fit.fitting import IRLSResult, constraint_test, constraints, fit_joint, names_of
from fit.model import Sharing
from fit.parallel import one_blas_thread, parallel_map, progress_stage
from fit.requirements import TAPER
from fit.results import Fit, Provenance, Results
from fit.settings import ParameterSettings, Settings, settings
from fit.spacecraft import check_same
from fit.statistics import variance
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
    chosen = chosen or settings()
    progress_stage(0.45)
    campaign = checked(paired(telemetries, chosen), "samples", "gaps", "files", "equation")
    progress_stage(0.65)
    campaign = checked(campaign, "limits", "residual", "o_1").fit_each()  # residuals of an initial fit
    campaign = checked(campaign, "noise").fit_each()  # those whose noise levels are fitted
    campaign = checked(campaign, "drift")
    progress_stage(0.95)
    campaign, joint = fit_jointly(campaign, chosen)
    experiments = fit_singly(campaign, chosen)
    results = assemble(campaign, joint, experiments, chosen)
    return inertial.with_inertial(results, telemetries, chosen.parameters)


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
    inertial.check_runs(telemetries, calibration)
    recorded = inertial.with_constraints(calibration, telemetries, parameters or {})
    return inertial.with_inertial(recorded, telemetries, parameters or {})


class JointFit(NamedTuple):
    """The runs that agree, their joint fit with what the user says of parameters, and its test."""

    agreed: Agreement
    outcome: IRLSResult
    correction: attenuation.AttenuationCorrected | None
    test: constraint_test.ConstraintTest


def paired(telemetries: Sequence[Telemetry], chosen: Settings) -> Campaign:
    """Return the experiments of runs, and who takes part in their joint fit."""
    check_same(telemetries)
    of_band = (e.limit_band(chosen.f_max) for e in pair(telemetries))
    experiments = [e.with_parameters(chosen.parameters) for e in of_band]
    if not experiments:
        paths = ", ".join(str(t.path) for t in telemetries) or "no telemetry"
        raise InputError(
            f"{paths}: no run of kind 'sysid', expected at least one to calibrate with, or an earlier "
            "calibration"
        )
    common_x_axis(telemetries)
    wider: dict[str, ParameterSettings] = {}
    if chosen.parameters:
        runs = [(e.sysid.telemetry, e.parameters) for e in experiments]
        assumed = {p.name: p.assumed_sigma for p in Sharing(chosen.shared).parameters(runs)}
        constraints.check(chosen.parameters, [*assumed, *euler_fit.names(telemetries)], "fit.parameters")
        wider = {
            name: ParameterSettings(prior=setting.prior)
            for name, setting in chosen.parameters.items()
            if setting.prior and setting.prior[1] > assumed.get(name, 0.0) > 0
        }
    # what the data are like is judged without what the user says of parameters: that may be wrong, but for
    # priors that say less than what is assumed
    unconstrained = chosen.model_copy(update={"parameters": wider})
    campaign = Campaign({e.name: e for e in experiments}, unconstrained)
    return campaign.decide(participation(experiments, chosen))


def fit_jointly(campaign: Campaign, chosen: Settings) -> tuple[Campaign, JointFit | None]:
    """Fit jointly what agrees, then with what the user says of parameters."""
    if not campaign.in_joint_fit:
        return campaign, None
    agreed = fit_consistent_runs(campaign.in_joint_fit, campaign.fits, campaign.settings)
    campaign = campaign.decide([*apply("agreement", agreed), *apply("joint", agreed)])
    campaign = replace(campaign, findings=explain_findings(campaign, agreed))
    outcome = agreed.outcome
    if any(setting.is_constraint for setting in chosen.parameters.values()):
        constrained = chosen.model_copy(update={"scatter": [*outcome.scatter]})
        try:
            fit = fit_joint(agreed.experiments, constrained, campaign.fits)
        except FitError as error:
            names = ", ".join(chosen.parameters)
            raise FitError(f"{error}; without the constraints of {names} there is one") from error
        outcome = replace(fit, data_driven=outcome.data_driven)
    has_couplings = any(e.sysid.channels.means for e in agreed.experiments)
    correction = attenuation.correct_attenuation(outcome, agreed.experiments) if has_couplings else None
    test = constraint_test.refit_unconstrained(outcome, reference=agreed.outcome)
    return campaign, JointFit(agreed, outcome, correction, test)


def fit_singly(campaign: Campaign, chosen: Settings) -> dict[str, Fit | Finding]:
    """Return the fit of each experiment by itself with what is found of it, or that there is none."""

    def fit_one(e: Experiment) -> Fit | Finding:
        judged = single = campaign.fits[e.name]
        if names_of(e).keys() & chosen.parameters.keys():  # these may be wrong
            single = fit_single(e, chosen, judged)
        if isinstance(single, FitError) or isinstance(judged, FitError):
            error = judged if isinstance(judged, FitError) else single
            return Finding("no_single_fit", str(error), e.name)
        fit = as_fit(single, [e])
        of_data = fit if judged is single else as_fit(judged, [e])
        findings = [*campaign.of_run(e.name), *(residual.of_experiment(e.name, of_data) if e.noise else ())]
        findings += constraint_test.refit_unconstrained(single, reference=judged).warnings
        return replace(fit, diagnostics=variance.diagnose(e, single)).add(findings)

    every = campaign.experiments
    return dict(zip(every, parallel_map(fit_one, [*every.values()]), strict=True))


def assemble(
    campaign: Campaign, joint: JointFit | None, single: Mapping[str, Fit | Finding], chosen: Settings
) -> Results:
    """Return the results of the dynamics: what is found goes with the fits that it concerns."""
    fits = {name: fit for name, fit in single.items() if isinstance(fit, Fit)}
    failures = [failure for failure in single.values() if isinstance(failure, Finding)]
    if not joint:
        if not fits:
            raise FitError("; ".join(failure.message for failure in failures))
        fits = {name: fit.add(failures) for name, fit in fits.items()}
        return Results(None, fits, {}, {}, provenance(campaign, joint, chosen))
    fit = as_fit(joint.outcome, joint.agreed.experiments).add([*joint.test.warnings, *campaign.of_joint])
    # of those that are left out is said what is wrong
    fit = fit.add(failure for failure in failures if failure.run not in campaign.faulty)
    codes = {finding.code for finding in fit.warnings}
    if "constraint_contradicted" not in codes:
        members = [(e.name, fits[e.name]) for e in campaign.in_joint_fit if e.name in fits]
        fit = fit.add(finding for finding in residual.of_joint(fit, members) if finding.code not in codes)
    cross_talk: dict[str, Fit] = {}
    if joint.correction:
        sharing = Sharing(chosen.shared)
        fit = attenuation.correct_joint(fit, joint.outcome, joint.correction)
        cross_talk = crosstalk_fit.cross_talk(
            joint.outcome, campaign.in_joint_fit, sharing, joint.correction, fit.warnings
        )
    return Results(fit, fits, cross_talk, {}, provenance(campaign, joint, chosen))


def provenance(campaign: Campaign, joint: JointFit | None, chosen: Settings) -> Provenance:
    """Return how results came about."""
    every, periods = [*campaign.experiments.values()], dict[str, set[str]]()
    members = campaign.in_joint_fit
    for run in (e.sysid.telemetry for e in members):
        periods.setdefault(str(run.alignment_epoch), set()).add(inertial_period(run))
    scatter = joint.outcome.scatter if joint else {}
    statistics = joint.agreed.statistics if joint else None
    subtraction = crosstalk_fit.subtraction(joint.outcome, members, Sharing(chosen.shared)) if joint else None
    return Provenance(
        joint_runs=[e.sysid.telemetry.run for e in members],
        noise_runs={e.sysid.telemetry.run: e.noise.telemetry.run for e in every if e.noise},
        f_max=chosen.f_max,
        window=f"Tukey {TAPER:g}",
        cross_talk_periods={epoch: next(iter(names)) for epoch, names in periods.items() if len(names) == 1},
        subtraction=subtraction or None,
        settings=chosen.record(),
        extra={"agreement": statistics} if statistics else {},
        levels=[e.name for e in members if e.marginalised],
        x_axis=every[0].sysid.telemetry.x_axis,
        scatter={name: {"value": s, "sigma": sigma} for name, (s, sigma) in scatter.items()},
    )
