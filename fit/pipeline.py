"""From telemetry to results: masks, single fits, joint fit, verdict, cross-talk, inertial forces."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from fit.consistency import explained, fit_consistent_runs, model_warnings
from fit.crosstalk import attenuation, centrifugal, crosstalk_fit, euler_fit
from fit.errors import FitError, InputError
from fit.false_alarms import budget_by_family
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
    Exclusion,
    ExperimentSet,
    MaskedExperiment,
    fit_quality,
    glitch_search_enabled,
    has_spectra,
    mask_experiments,
    metadata,
    noise_adaptation,
    noise_tests,
    unit_faults,
)
from fit.requirements import TAPER
from fit.results import Fit, Provenance, Results, check_frame
from fit.settings import ParameterSettings, Settings, settings
from fit.telemetry import Telemetry, common_x_axis, inertial_period
from fit.warnings import FitWarning
from fit.whitening import Experiment, divide, pair

PARAMETERS = "fit.parameters"


@one_blas_thread
def calibrate(telemetries: Sequence[Telemetry], chosen: Settings | None = None) -> Results:
    """Calibrate the dynamics and, where there are long noise runs with torques, the inertial forces.

    Parameters
    ----------
    telemetries : sequence of Telemetry
        Runs of any sample rates, a sysid run and a noise run for each experiment.
    chosen : Settings, optional
        What the user chose, the default otherwise.

    Raises
    ------
    InputError
        If there is nothing to fit, or if runs state different frames.
    FitError
        If no trustworthy estimate comes out.
    """
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
            raise InputError(
                f"{run.path}: a sysid run, expected noise runs only beside an earlier calibration"
            )
        check_frame(calibration, run)
    if not any(map(euler_fit.takes_part, telemetries)):
        raise InputError(
            f"{_where(telemetries)}: no noise run of {euler_fit.SHORTEST / 3600:g} h or more with torques "
            "about phi and eta (N_phi_1, N_eta_1), expected at least one"
        )
    constraints.check(parameters or {}, euler_fit.names(telemetries), PARAMETERS)
    turned = replace(calibration.provenance, x_axis=common_x_axis(telemetries))
    return _with_inertial(replace(calibration, provenance=turned), telemetries, parameters or {})


def _where(telemetries: Sequence[Telemetry]) -> str:
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
        said = constraints.of_fit(parameters, {f"{name}_{period}": name for name in euler_fit.NAMES})
        return period, _doubted(euler_fit.fit_period(periods[period], joint, said), joint)

    fits = dict(parallel_map(fitted, periods))
    names = {name: [run.run for run in runs] for name, runs in periods.items()}
    return replace(
        results,
        inertial={**results.inertial, **fits},
        cross_talk=_separated(results, fits),
        provenance=replace(results.provenance, inertial_runs=names, inertial_band=list(euler_fit.BAND)),
    )


def _separated(results: Results, fits: Mapping[str, Fit]) -> dict[str, Fit]:
    """Take the Euler force off the cross-talk of every epoch whose runs lie in one fitted period."""
    found, apart = dict(results.cross_talk), separation(results.provenance.frame)
    for epoch, period in (results.provenance.cross_talk_periods or {}).items():
        told = period in fits and not centrifugal.contradicts(fits[period].warnings)
        if told and epoch in found and not crosstalk_fit.is_separated(found[epoch]):
            found[epoch] = crosstalk_fit.subtract_euler_force(found[epoch], fits[period], period, apart)
    return found


@dataclass(frozen=True)
class _Together:
    """The joint fit, the experiments left out of it, and the statistics of their agreement."""

    outcome: IRLSResult
    fit: Fit
    left_out: tuple[Exclusion, ...]
    agreement: dict[str, dict[str, float]] | None


def _dynamics(telemetries: Sequence[Telemetry], chosen: Settings) -> Results:
    """Fit the experiments, each on its own and jointly, and the cross-talk that was fitted along."""
    progress_stage(0.1)
    found = [experiment.up_to(chosen.f_max) for experiment in pair(telemetries)]
    if not found:
        raise InputError(
            f"{_where(telemetries)}: no run of kind 'sysid', expected at least one to calibrate with, "
            "or an earlier calibration"
        )
    common_x_axis(telemetries)
    if chosen.parameters:
        runs = [(e.sysid.telemetry, e.parameters) for e in found]
        names = [p.name for p in Sharing(chosen.shared).parameters(runs)]
        constraints.check(chosen.parameters, [*names, *euler_fit.names(telemetries)], PARAMETERS)
    # what the data are like is judged without what the user says of parameters: that may be wrong
    asked, chosen = chosen, chosen.model_copy(update={"parameters": {}})
    ready = _prepared(found, chosen).without(metadata.mislabelled(found, telemetries))
    progress_stage(0.65)
    ready = ready.with_warnings(noise_adaptation.adapt_to_readout_excess(ready.usable, chosen))
    alone = _each_alone(ready.experiments, chosen)
    ready, alone = _noises(ready, alone, chosen)
    warned = ((name, w) for name, p in ready.prepared.items() for w in p.warnings)
    misfits = {name: w.message for name, w in warned if w.code == noise_adaptation.MISMATCH}
    progress_stage(0.95)
    together = _together(ready, alone, chosen, misfits, asked.parameters)
    if together:
        ready = replace(ready.without(together.left_out), exclusions=together.left_out)
    joint, own = _judged(ready, alone, together, asked)
    joint, cross_talk = _cross_talk(ready, together, joint, chosen)
    return Results(joint, own, cross_talk, {}, _provenance(ready, together, asked))


def _prepared(found: Sequence[Experiment], chosen: Settings) -> ExperimentSet:
    """Mask what the equation does not hold for and decide who takes part in the joint fit."""
    progress_stage(0.25)
    # one without spectra has its error from the masks
    tested = [e for e in found if e.name not in chosen.exclude]
    spectra = parallel_map(has_spectra, tested, Experiment.samples)
    tested = [e for e, has in zip(tested, spectra, strict=True) if has]
    first = metadata.screen(tested)
    left_out, faulty = first.exclusions, {f.experiment for f in first.exclusions}
    misfit = model_warnings([e for e in tested if e.name not in faulty])
    if misfit:  # which would pass for glitches and changes, and be masked
        chosen = chosen.model_copy(update={"glitches": False})
    progress_stage(0.45)
    made = mask_experiments(found, chosen, faulty)
    prepared = {name: p for name, p in made.items() if isinstance(p, MaskedExperiment)}
    refused = {name: p for name, p in made.items() if isinstance(p, InputError) and name not in faulty}
    left_out += [Exclusion(name, str(error)) for name, error in refused.items()]
    together = [prepared[e.name].experiment if e.name in prepared else e for e in found]
    taking_part, short, excluded = divide(together, chosen)
    ready = ExperimentSet(prepared, tuple(taking_part), tuple(short), tuple(excluded)).without(left_out)
    searched = ready.in_joint_fit if glitch_search_enabled(chosen) else ()  # else glitches pass for changes
    then = metadata.changes(searched)
    ready = replace(ready, notes=(*first.notes, *misfit, *then.notes)).without(then.exclusions)
    return ready.without_unusable()


def _noises(
    ready: ExperimentSet, alone: dict[str, IRLSResult | FitError], chosen: Settings
) -> tuple[ExperimentSet, dict[str, IRLSResult | FitError]]:
    """Judge the noise of every experiment by its own fit; fit anew by itself where it is not as it seemed."""
    of_levels = ready.usable if chosen.levels == ["auto"] else ready.experiments
    ready = ready.with_warnings(noise_adaptation.adapt_to_levels(of_levels, alone, chosen))
    alone = alone | _each_alone([e for e in ready.experiments if e.marginalised], chosen)
    ready = ready.with_warnings(noise_adaptation.adapt_to_nonstationarity(ready.usable, alone))
    return ready, alone | _each_alone([e for e in ready.experiments if e.segment_variances], chosen)


def _each_alone(experiments: Sequence[Experiment], chosen: Settings) -> dict[str, IRLSResult | FitError]:
    fits = parallel_map(lambda e: _alone(e, chosen), experiments, Experiment.samples)
    return {e.name: own for e, own in zip(experiments, fits, strict=True)}


def _alone(
    e: Experiment, chosen: Settings, begun: IRLSResult | FitError | None = None
) -> IRLSResult | FitError:
    """Fit one experiment."""
    try:
        return fit_experiment(e, chosen.estimator, begun, chosen.parameters)
    except FitError as error:
        return error


def _together(
    ready: ExperimentSet,
    alone: Mapping[str, IRLSResult | FitError],
    chosen: Settings,
    misfits: Mapping[str, str],
    parameters: Mapping[str, ParameterSettings],
) -> _Together | None:
    """Fit jointly what agrees, then with what the user says of parameters."""
    if not ready.in_joint_fit:
        return None
    agreed = fit_consistent_runs(ready.in_joint_fit, alone, chosen, misfits)
    outcome = agreed.outcome
    if any(said.is_constraint for said in parameters.values()):
        asked = chosen.model_copy(update={"parameters": parameters, "scatter": list(outcome.scatter)})
        try:
            outcome = replace(fit_joint(agreed.experiments, asked, alone), by_data=outcome.by_data)
        except FitError as error:
            names = ", ".join(parameters)
            raise FitError(f"{error}; it does without what the settings say of {names}") from error
    more = (*agreed.warnings, *constraint_test.refit_unconstrained(outcome).warnings())
    fit = _warned(fit_quality.as_fit(outcome, agreed.experiments), more)
    left_out = explained(
        (*ready.exclusions, *agreed.left_out), ready.experiments, alone, agreed, Sharing(chosen.shared)
    )
    return _Together(outcome, fit, left_out, agreed.statistics)


def _judged(
    ready: ExperimentSet,
    alone: Mapping[str, IRLSResult | FitError],
    together: _Together | None,
    chosen: Settings,
) -> tuple[Fit | None, dict[str, Fit]]:
    """Return the joint fit and those of the experiments, with what keeps them from being trusted."""
    fits: dict[str, Fit] = {}
    of_joint: list[FitWarning] = []
    every = ready.experiments
    own = parallel_map(lambda e: _of_experiment(e, ready, alone[e.name], together, chosen), every)
    for e, found in zip(every, own, strict=True):
        if isinstance(found, Fit):
            fits[e.name] = found
        elif not ready.warnings_of(e.name):  # of which is said what is wrong
            of_joint.append(found)
    of_joint += [*ready.notes, *(f.of_joint for f in ready.exclusions)]
    for code, why, left_out in (
        ("short_run", "being shorter than 6 h", ready.short),
        ("excluded", "as the settings say", ready.excluded),
    ):
        if left_out:
            names = ", ".join(e.sysid.telemetry.run for e in left_out)
            warning = FitWarning(code, (), f"left out of the joint fit, {why}: {names}")
            of_joint.append(warning)
            for e in (e for e in left_out if e.name in fits):
                fits[e.name] = _warned(fits[e.name], [warning])
    if not together:
        return None, fits
    of_joint += [w for e in ready.in_joint_fit for w in ready.prepared[e.name].warnings]
    said = {w.code for w in together.fit.warnings}
    if "constraint_contradicted" not in said:
        of_joint += [
            w for w in fit_quality.of_joint(together.fit, fits, ready.in_joint_fit) if w.code not in said
        ]
    return _warned(together.fit, of_joint), fits


def _of_experiment(
    experiment: Experiment,
    ready: ExperimentSet,
    own: IRLSResult | FitError,
    together: _Together | None,
    chosen: Settings,
) -> Fit | FitWarning:
    """Return the fit of an experiment by itself, or a warning of the joint fit that there is none."""
    judged = own
    if constraints_of(experiment, chosen.parameters):  # these may be wrong
        own = _alone(experiment, chosen, own)
    if isinstance(own, FitError) or isinstance(judged, FitError):
        error = next(e for e in (judged, own) if isinstance(e, FitError))
        if together is None:
            raise error
        # what one experiment by itself does not yield must not cost the joint fit
        return FitWarning("no_single_fit", (), str(error))
    fit = fit_quality.as_fit(own, [experiment])
    untested = unit_faults(experiment) if experiment.name in chosen.exclude else ()
    more = (
        *ready.warnings_of(experiment.name),
        *(warning for fault in untested for warning in fault.of_own),
        *ready.prepared[experiment.name].warnings,
        *fit_quality.of_experiment(experiment, fit_quality.as_fit(judged, [experiment])),
        *constraint_test.refit_unconstrained(own).warnings(),
    )
    diagnostics = noise_tests.diagnose(experiment, own)
    return _warned(replace(fit, diagnostics=diagnostics), more)


def _cross_talk(
    ready: ExperimentSet, together: _Together | None, judged: Fit | None, chosen: Settings
) -> tuple[Fit | None, dict[str, Fit]]:
    """Return the joint fit and the cross-talk of every epoch; where runs turn, that holds the Euler force."""
    if not (together and judged and any(e.sysid.channels.means for e in ready.in_joint_fit)):
        return judged, {}
    correction = attenuation.correct_attenuation(together.outcome, ready.in_joint_fit)
    joint = attenuation.apply_iv(judged, together.outcome, correction)
    found = crosstalk_fit.cross_talk(together.outcome, ready.in_joint_fit, Sharing(chosen.shared), correction)
    if any(rotation.sources(e.sysid.telemetry) for e in ready.in_joint_fit):
        found = {epoch: crosstalk_fit.with_euler_warning(fit) for epoch, fit in found.items()}
    return joint, {epoch: _doubted(fit, judged) for epoch, fit in found.items()}


def _warned(fit: Fit, more: Iterable[FitWarning]) -> Fit:
    return replace(fit, warnings=(*fit.warnings, *more))


def _doubted(fit: Fit, joint: Fit | None) -> Fit:
    """Return a fit that rests on the joint fit with what keeps that from being sound."""
    return _warned(fit, joint.unsound if joint else ())


def _provenance(ready: ExperimentSet, together: _Together | None, chosen: Settings) -> Provenance:
    periods: dict[str, set[str]] = {}
    for run in (e.sysid.telemetry for e in ready.in_joint_fit):
        periods.setdefault(str(run.alignment_epoch), set()).add(inertial_period(run))
    scatter = together.outcome.scatter if together else {}
    agreement = {"agreement": together.agreement} if together and together.agreement else {}
    best = (
        crosstalk_fit.subtraction(together.outcome, ready.in_joint_fit, Sharing(chosen.shared))
        if together
        else {}
    )
    return Provenance(
        joint_runs=[e.sysid.telemetry.run for e in ready.in_joint_fit],
        noise_runs={e.sysid.telemetry.run: e.noise.telemetry.run for e in ready.experiments if e.noise},
        f_max=chosen.f_max,
        window=f"Tukey {TAPER:g}",
        cross_talk_periods={epoch: next(iter(names)) for epoch, names in periods.items() if len(names) == 1},
        subtraction=best or None,
        settings=chosen.record(),
        more={"false_alarms": budget_by_family(), **agreement},
        levels=[e.name for e in ready.in_joint_fit if e.marginalised],
        x_axis=ready.experiments[0].sysid.telemetry.x_axis,
        scatter={name: {"value": s, "sigma": sigma} for name, (s, sigma) in scatter.items()},
    )
