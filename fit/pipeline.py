"""From telemetry to results: pair the runs, fit each experiment, all jointly, then the inertial periods."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from fit.errors import FitError, InputError
from fit.estimate import (
    Experiment,
    Known,
    Outcome,
    as_fit,
    bump,
    diagnose,
    divide,
    fit_experiment,
    fit_joint,
    inertial,
    is_separated,
    known_of,
    pair,
    prepare,
    verdict,
)
from fit.model import Sharing, rotation
from fit.results import Fit, FitWarning, Results
from fit.settings import Settings, settings
from fit.signal import derivatives, spectra
from fit.telemetry import Telemetry, inertial_period


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
    experiments = pair(telemetries)
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
    fits = {
        name: _doubted(inertial.fit_period(runs, results.joint), results.joint)
        for name, runs in periods.items()
        if results.joint
    }
    if not fits:
        return results
    runs = {name: [run.run for run in runs] for name, runs in periods.items()}
    return replace(
        results,
        inertial={**results.inertial, **fits},
        cross_talk=_separated(results, fits),
        provenance={**results.provenance, "inertial_runs": runs, "inertial_band": list(inertial.BAND)},
    )


def _doubted(fit: Fit, joint: Fit | None) -> Fit:
    """Return a fit that rests on the joint fit with what keeps that from being sound."""
    return replace(fit, warnings=(*fit.warnings, *(joint.unsound if joint else ())))


def _separated(results: Results, fits: Mapping[str, Fit]) -> dict[str, Fit]:
    """Take the Euler force off the cross-talk of every epoch whose runs lie in one fitted period."""
    periods = results.provenance.get("cross_talk_periods")
    found = dict(results.cross_talk)
    for epoch, period in periods.items() if isinstance(periods, dict) else ():
        if period in fits and epoch in found and not is_separated(found[epoch]):
            found[epoch] = bump.separate(found[epoch], fits[period], period)
    return found


def _dynamics(found: Sequence[Experiment], chosen: Settings) -> Results:
    """Fit the experiments, each on its own and jointly."""
    sharing = Sharing(chosen.shared)
    prepared = {p.experiment.name: p for p in prepare(found, chosen)}
    experiments = [p.experiment for p in prepared.values()]
    taking_part, short, excluded = divide(experiments, chosen)
    spoilt = [e for e in taking_part if prepared[e.name].spoilt]
    if len(spoilt) < len(taking_part):  # else chi2 will tell
        taking_part = [e for e in taking_part if e not in spoilt]
    alone = {e.name: _alone(e, None, chosen) for e in experiments}
    fitted = {name: own for name, own in alone.items() if isinstance(own, Outcome)}
    for e in taking_part:
        verdict.check_guidance(e.sysid.telemetry)
    verdict.check_gains(fitted, taking_part)
    try:
        outcome = fit_joint(taking_part, chosen) if taking_part else None
    except FitError as error:
        raise FitError(f"{error}{verdict.suspects(alone)}") from error
    if outcome:  # what determines a gain only together
        verdict.check_gains({e.name: outcome for e in taking_part}, taking_part)
    joint = as_fit(outcome, taking_part) if outcome else None
    fits, of_joint = {}, []
    for e in experiments:
        known = known_of(outcome, e.sysid, sharing) if outcome else None
        own = alone[e.name]
        if known and (isinstance(own, FitError) or own.tone):  # a single tone needs what others know
            own = _alone(e, known, chosen)
        if isinstance(own, FitError):
            if joint is None:
                raise own
            # what one experiment by itself does not yield must not cost the joint fit
            of_joint.append(FitWarning("not_fitted_alone", (), str(own)))
            continue
        fit = as_fit(own, [e], from_joint=bool(known and own.tone))
        more = (*prepared[e.name].warnings, *verdict.of_experiment(e, own, fit))
        fits[e.name] = replace(fit, diagnostics=diagnose(e, own), warnings=(*fit.warnings, *more))
    for e in spoilt:
        if e not in taking_part:
            of_joint.append(
                FitWarning("excluded", (), f"left out of the joint fit: {prepared[e.name].spoilt}")
            )
    for code, why, left_out in (
        ("short_run", "being shorter than 6 h", short),
        ("excluded", "as the settings say", excluded),
    ):
        if left_out:
            names = ", ".join(e.sysid.telemetry.run for e in left_out)
            warning = FitWarning(code, (), f"left out of the joint fit, {why}: {names}")
            of_joint.append(warning)
            for e in (e for e in left_out if e.name in fits):
                fits[e.name] = replace(fits[e.name], warnings=(*fits[e.name].warnings, warning))
    if joint:
        of_joint += [w for e in taking_part for w in prepared[e.name].warnings]
        of_joint += verdict.of_joint(joint, fits, taking_part)
        joint = replace(joint, warnings=(*joint.warnings, *of_joint))
    cross_talk = bump.cross_talk(outcome, taking_part, sharing) if outcome else {}
    periods: dict[str, set[str]] = {}
    for e in taking_part:
        run = e.sysid.telemetry
        periods.setdefault(str(run.alignment_epoch), set()).add(inertial_period(run))
    single = {epoch: next(iter(names)) for epoch, names in periods.items() if len(names) == 1}
    scatter = outcome.scatter if outcome else {}
    provenance = {
        **_provenance(experiments, taking_part),
        "cross_talk_periods": single,
        "settings": chosen.model_dump(),
        "scatter": {name: {"value": s, "sigma": sigma} for name, (s, sigma) in scatter.items()},
    }
    turning = any(rotation.sources(e.sysid.telemetry) for e in taking_part)
    cross_talk = {k: bump.joined(f) if turning else f for k, f in cross_talk.items()}
    cross_talk = {k: _doubted(f, joint) for k, f in cross_talk.items()}
    return Results(joint, fits, cross_talk, {}, provenance)


def _alone(experiment: Experiment, known: Known | None, chosen: Settings) -> Outcome | FitError:
    """Fit one experiment; if it holds a single tone, on what the joint fit knows from others."""
    try:
        return fit_experiment(experiment, known, chosen.estimator)
    except FitError as error:
        return error


def _provenance(experiments: Sequence[Experiment], taking_part: Sequence[Experiment]) -> dict[str, object]:
    return {
        "joint_runs": [e.sysid.telemetry.run for e in taking_part],
        "noise_runs": {e.sysid.telemetry.run: e.noise.telemetry.run for e in experiments if e.noise},
        "f_max": derivatives.F_MAX,
        "window": f"Tukey {spectra.TAPER:g}",
    }
