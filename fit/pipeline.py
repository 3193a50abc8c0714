"""From telemetry to results: pair the runs, fit each experiment, all jointly, then the inertial periods."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from fit import bump, glitches, inertial, rotation, selection, separation, spectra
from fit.diagnostics import diagnose
from fit.errors import FitError, InputError
from fit.irls import Outcome
from fit.joint import fit_experiment, fit_joint, known_of
from fit.results import Fit, FitWarning, Results
from fit.runs import Experiment
from fit.settings import Settings, settings
from fit.sharing import Sharing
from fit.telemetry import Telemetry, inertial_period
from fit.verdict import as_fit


def calibrate(telemetries: Sequence[Telemetry], chosen: Settings | None = None) -> Results:
    """Calibrate the dynamics and, where there are long noise runs with torques, the inertial forces.

    Parameters
    ----------
    telemetries : sequence of Telemetry
        Runs of any sample rates; each sysid run is paired with the noise run of the same experiment.
    chosen : Settings, optional
        What the user chose, the default otherwise.

    Raises
    ------
    InputError
        If there is nothing to fit, or a run and its noise run do not belong together.
    FitError
        If no trustworthy estimate comes out.
    """
    experiments = selection.experiments(telemetries)
    if not experiments:
        raise InputError(
            f"{_where(telemetries)}: no run of kind 'sysid', expected at least one to calibrate with, "
            "or an earlier calibration"
        )
    return _with_inertial(_dynamics(experiments, chosen or settings()), telemetries)


def calibrate_inertial(telemetries: Sequence[Telemetry], calibration: Results) -> Results:
    """Calibrate the inertial forces alone; everything else is carried over.

    Parameters
    ----------
    telemetries : sequence of Telemetry
        Noise runs of any sample rates.
    calibration : Results
        Of the dynamics, with a joint fit.

    Raises
    ------
    InputError
        If there is a sysid run, or no run that lets the inertial forces be fitted.
    FitError
        If no trustworthy estimate comes out.
    """
    for run in telemetries:
        if run.kind == "sysid":
            raise InputError(
                f"{run.path}: a sysid run, expected noise runs only beside an earlier calibration"
            )
    if not any(map(inertial.takes_part, telemetries)):
        raise InputError(
            f"{_where(telemetries)}: no noise run of {inertial.SHORTEST / 3600:g} h or more with torques "
            "about phi and eta (N_phi_1, N_eta_1), expected at least one"
        )
    return _with_inertial(calibration, telemetries)


def _where(telemetries: Sequence[Telemetry]) -> str:
    return ", ".join(str(t.path) for t in telemetries) or "no telemetry"


def _with_inertial(results: Results, telemetries: Sequence[Telemetry]) -> Results:
    """Fit the inertial periods that the runs belong to; they need the dynamics of a joint fit."""
    periods: dict[str, list[Telemetry]] = {}
    for run in telemetries if results.joint else ():
        if inertial.takes_part(run):
            periods.setdefault(inertial_period(run), []).append(run)
    fits = {name: inertial.fit_period(runs, results.joint) for name, runs in periods.items() if results.joint}
    if not fits:
        return results
    runs = {name: [run.run for run in runs] for name, runs in periods.items()}
    return replace(
        results,
        inertial={**results.inertial, **fits},
        cross_talk=_separated(results, fits),
        provenance={**results.provenance, "inertial_runs": runs, "inertial_band": list(inertial.BAND)},
    )


def _separated(results: Results, fits: Mapping[str, Fit]) -> dict[str, Fit]:
    """Take the Euler force off the cross-talk of every epoch whose runs lie in one fitted period."""
    periods = results.provenance.get("cross_talk_periods")
    found = dict(results.cross_talk)
    for epoch, period in periods.items() if isinstance(periods, dict) else ():
        if period in fits and epoch in found and not separation.is_separated(found[epoch]):
            found[epoch] = separation.separate(found[epoch], fits[period], period)
    return found


def _dynamics(found: Sequence[Experiment], chosen: Settings) -> Results:
    """Fit the experiments, each on its own and jointly."""
    sharing = Sharing(chosen.shared)
    masking = chosen.glitches and chosen.estimator != "flscov"  # which bridges what is masked
    cleaned = [glitches.clean(e) if masking else (e, ()) for e in found]
    experiments = [e for e, _ in cleaned]
    taking_part, short, excluded = selection.divide(experiments, chosen)
    spoilt = [e for e, told in cleaned if e in taking_part and any(w.code == glitches.TOO_MANY for w in told)]
    if len(spoilt) < len(taking_part):  # else chi2 will tell
        taking_part = [e for e in taking_part if e not in spoilt]
    outcome = fit_joint(taking_part, chosen) if taking_part else None
    joint = as_fit(outcome, taking_part) if outcome else None
    fits = {}
    for e in experiments:
        try:
            fits[e.name] = _fit_alone(e, outcome, chosen)
        except FitError as error:
            if joint is None:
                raise
            # what one experiment by itself does not yield must not cost the joint fit
            joint = replace(joint, warnings=(*joint.warnings, FitWarning("not_fitted_alone", (), str(error))))
    for code, why, left_out in (
        ("short_run", "being shorter than 6 h", short),
        ("excluded", "as the settings say", excluded),
        ("excluded", "for too many glitches", [e for e in spoilt if e not in taking_part]),
    ):
        if left_out:
            names = ", ".join(e.sysid.telemetry.run for e in left_out)
            warning = FitWarning(code, (), f"left out of the joint fit, {why}: {names}")
            joint = joint and replace(joint, warnings=(*joint.warnings, warning))
            for e in (e for e in left_out if e.name in fits):
                fits[e.name] = replace(fits[e.name], warnings=(*fits[e.name].warnings, warning))
    for e, told in cleaned:
        if told and e.name in fits:
            fits[e.name] = replace(fits[e.name], warnings=(*fits[e.name].warnings, *told))
        if told and (e in taking_part or e in spoilt):
            joint = joint and replace(joint, warnings=(*joint.warnings, *told))
    cross_talk = bump.cross_talk(outcome, taking_part, sharing) if outcome else {}
    periods: dict[str, set[str]] = {}
    for e in taking_part:
        run = e.sysid.telemetry
        periods.setdefault(str(run.alignment_epoch), set()).add(inertial_period(run))
    alone = {epoch: next(iter(found)) for epoch, found in periods.items() if len(found) == 1}
    scatter = outcome.scatter if outcome else {}
    provenance = {
        **_provenance(experiments, taking_part),
        "cross_talk_periods": alone,
        "settings": chosen.model_dump(),
        "scatter": {name: {"value": s, "sigma": sigma} for name, (s, sigma) in scatter.items()},
    }
    turning = any(rotation.sources(e.sysid.telemetry) for e in taking_part)
    cross_talk = {k: separation.joined(f) if turning else f for k, f in cross_talk.items()}
    return Results(joint, fits, cross_talk, {}, provenance)


def _fit_alone(experiment: Experiment, joint: Outcome | None, chosen: Settings) -> Fit:
    """Fit one experiment; if it holds a single tone, on what the joint fit knows from others."""
    known = known_of(joint, experiment.sysid.telemetry, Sharing(chosen.shared)) if joint else None
    outcome = fit_experiment(experiment, known, chosen.estimator)
    fit = as_fit(outcome, [experiment], from_joint=bool(known and outcome.tone))
    return replace(fit, diagnostics=diagnose(experiment, outcome))


def _provenance(experiments: Sequence[Experiment], taking_part: Sequence[Experiment]) -> dict[str, object]:
    return {
        "joint_runs": [e.sysid.telemetry.run for e in taking_part],
        "noise_runs": {e.sysid.telemetry.run: e.noise.telemetry.run for e in experiments if e.noise},
        "f_max": spectra.F_MAX,
        "window": f"Tukey {spectra.TAPER:g}",
    }
