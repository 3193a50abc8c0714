"""From telemetry to results: pair the runs, fit each experiment, fit them jointly."""

import math
from collections.abc import Sequence
from dataclasses import replace

from fit import spectra
from fit.errors import InputError
from fit.irls import Outcome
from fit.joint import fit_experiment, fit_joint, known_of
from fit.results import Fit, FitWarning, Results
from fit.runs import Experiment, Run
from fit.telemetry import Telemetry
from fit.verdict import as_fit

JOINT_DURATION = 21600.0  # s: shorter runs hardly see the stiffness and take part only when asked to
SHORTEST = 1800.0  # s: below, the band holds too few bins for a noise PSD
TRIMMED = 0.005  # fraction a decimation may have cut from a run's ends


def calibrate(telemetries: Sequence[Telemetry], *, include_short: bool = False) -> Results:
    """Calibrate the dynamics.

    Parameters
    ----------
    telemetries : sequence of Telemetry
        Runs of any sample rates; each sysid run is paired with the noise run of the same experiment.
    include_short : bool
        Let runs shorter than 6 h take part in the joint fit.

    Raises
    ------
    InputError
        If there is nothing to fit, or a run and its noise run do not belong together.
    FitError
        If no trustworthy estimate comes out.
    """
    _check_names(telemetries)
    experiments = [_experiment(run, telemetries) for run in telemetries if run.kind == "sysid"]
    if not experiments:
        where = ", ".join(str(t.path) for t in telemetries) or "no telemetry"
        raise InputError(f"{where}: no run of kind 'sysid', expected at least one to calibrate with")
    taking_part = [e for e in experiments if include_short or not _is_short(e.sysid.telemetry)]
    outcome = fit_joint(taking_part) if taking_part else None
    joint = as_fit(outcome, taking_part) if outcome else None
    fits = {e.name: _fit_alone(e, outcome) for e in experiments}
    left_out = [e for e in experiments if e not in taking_part]
    if left_out:
        names = ", ".join(e.sysid.telemetry.run for e in left_out)
        warning = FitWarning("short_run", (), f"left out of the joint fit, being shorter than 6 h: {names}")
        joint = joint and replace(joint, warnings=(*joint.warnings, warning))
        for e in left_out:
            fits[e.name] = replace(fits[e.name], warnings=(*fits[e.name].warnings, warning))
    return Results(joint, fits, {}, {}, _provenance(experiments, taking_part))


def _fit_alone(experiment: Experiment, joint: Outcome | None) -> Fit:
    """Fit one experiment; if it holds a single tone, on what the joint fit knows from others."""
    known = known_of(joint, experiment.sysid.telemetry) if joint else None
    outcome = fit_experiment(experiment, known)
    return as_fit(outcome, [experiment], from_joint=bool(known and outcome.tone))


def _check_names(telemetries: Sequence[Telemetry]) -> None:
    seen: dict[tuple[str, str], Telemetry] = {}
    for run in telemetries:
        twin = seen.setdefault((run.experiment, run.kind), run)
        if twin is not run:
            raise InputError(
                f"{run.path}: a second {run.kind} run of experiment {run.experiment!r} beside {twin.path}, "
                "expected one"
            )


def _experiment(sysid: Telemetry, telemetries: Sequence[Telemetry]) -> Experiment:
    noise = next((t for t in telemetries if t.kind == "noise" and t.experiment == sysid.experiment), None)
    for run in (sysid, noise):
        if run is not None and run.duration < SHORTEST:
            raise InputError(f"{run.path}: lasts {run.duration:.6g} s, expected at least {SHORTEST:g} s")
    if noise is not None:
        for key in ("F_max_1", "F_max_2", "N_max_1", "N_max_2", "alignment_epoch"):
            here, there = getattr(noise, key), getattr(sysid, key)
            if not math.isclose(here, there, rel_tol=1e-6):
                raise InputError(
                    f"{noise.path}: attribute {key}: {here:g}, expected {there:g} as in {sysid.path}, "
                    "whose noise run it is"
                )
    return Experiment(Run(sysid), None if noise is None else Run(noise))


def _is_short(run: Telemetry) -> bool:
    return run.duration < JOINT_DURATION * (1 - TRIMMED)


def _provenance(experiments: Sequence[Experiment], taking_part: Sequence[Experiment]) -> dict[str, object]:
    return {
        "joint_runs": [e.sysid.telemetry.run for e in taking_part],
        "noise_runs": {e.sysid.telemetry.run: e.noise.telemetry.run for e in experiments if e.noise},
        "f_max": spectra.F_MAX,
        "window": f"Tukey {spectra.TAPER:g}",
    }
