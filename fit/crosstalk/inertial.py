"""The inertial periods of a calibration: the Euler force of long noise runs, and cross-talk without it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from fit.crosstalk import centrifugal, crosstalk_fit, euler_fit
from fit.errors import InputError
from fit.fitting import constraints
from fit.model import separation
from fit.parallel import parallel_map
from fit.results import Fit, Results, check_frame
from fit.settings import ParameterSettings, with_other_constraints
from fit.telemetry import Telemetry, common_x_axis, inertial_period


def check_runs(telemetries: Sequence[Telemetry], calibration: Results) -> None:
    """Refuse runs that no inertial fit with an earlier calibration can use.

    Raises
    ------
    InputError
        If there is a sysid run, no run with torques, or if frames differ.
    """
    for run in telemetries:
        if run.kind == "sysid":
            message = "a sysid run, expected noise runs only with an earlier calibration"
            raise InputError(f"{run.path}: {message}")
        check_frame(calibration, run)
    if not any(map(euler_fit.takes_part, telemetries)):
        paths = ", ".join(str(t.path) for t in telemetries) or "no telemetry"
        raise InputError(
            f"{paths}: no noise run of {euler_fit.MIN_DURATION / 3600:g} h or more with torques about phi "
            "and eta (N_phi_1, N_eta_1), expected at least one"
        )


def with_constraints(
    calibration: Results, telemetries: Sequence[Telemetry], parameters: Mapping[str, ParameterSettings]
) -> Results:
    """Return an earlier calibration with the frame of runs and the constraints of their angles on record."""
    angles = euler_fit.names(telemetries)
    constraints.check(parameters, angles, "fit.parameters")
    recorded = with_other_constraints(calibration.provenance.settings, angles, parameters)
    provenance = replace(calibration.provenance, x_axis=common_x_axis(telemetries), settings=recorded)
    return replace(calibration, provenance=provenance)


def with_inertial(
    results: Results, telemetries: Sequence[Telemetry], parameters: Mapping[str, ParameterSettings]
) -> Results:
    """Return results with the inertial periods that runs belong to, if there is a joint fit.

    Parameters
    ----------
    results : Results
        Of the dynamics.
    telemetries : sequence of Telemetry
        Runs, of which the long noise runs with torques take part.
    parameters : mapping of str to ParameterSettings
        Constraints of the user.
    """
    periods: dict[str, list[Telemetry]] = {}
    for run in filter(euler_fit.takes_part, telemetries):
        periods.setdefault(inertial_period(run), []).append(run)
    if (joint := results.joint) is None or not periods:
        return results

    def fitted(period: str) -> tuple[str, Fit]:
        fit = euler_fit.fit_period(periods[period], joint, period, parameters, len(periods))
        return period, fit.add(joint.unsound)

    fits = dict(parallel_map(fitted, periods))
    names = dict(results.provenance.inertial_runs or {})
    names |= {name: [run.run for run in runs] for name, runs in periods.items()}
    provenance = replace(results.provenance, inertial_runs=names, inertial_band=list(euler_fit.BAND))
    inertial, cross_talk = {**results.inertial, **fits}, separated(results, fits)
    return replace(results, inertial=inertial, cross_talk=cross_talk, provenance=provenance)


def separated(results: Results, fits: Mapping[str, Fit]) -> dict[str, Fit]:
    """Return the cross-talk without the Euler force, of every epoch whose runs lie in one fitted period."""
    cross_talk, d = dict(results.cross_talk), separation(results.provenance.frame)
    for epoch, period in (results.provenance.cross_talk_periods or {}).items():
        if epoch not in cross_talk or period not in fits:
            continue
        fit = cross_talk[epoch]
        if crosstalk_fit.is_separated(fit) and period in results.inertial:  # by an earlier fit of the period
            fit = crosstalk_fit.restore_euler_force(fit, results.inertial[period], d)
        if not crosstalk_fit.is_separated(fit) and not centrifugal.contradicts(fits[period].warnings):
            fit = crosstalk_fit.subtract_euler_force(fit, fits[period], period, d)
        cross_talk[epoch] = fit
    return cross_talk
