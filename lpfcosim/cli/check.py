"""The command ``check``: what to expect of a campaign before it is run."""

import json
from pathlib import Path

import fit.errors
from fit import settings as fit_settings
from fit.estimate import angles, forecast
from fit.parallel import processors
from fit.results import Fit
from fit.tables import Lines
from fit.weighing import SHORTEST
from lpfcosim.campaign import Campaign, loading
from lpfcosim.cli import margins as cli_margins
from lpfcosim.cli.console import Console
from lpfcosim.cli.forecast import left_out, messages, table
from lpfcosim.cli.planned import planned, turning
from lpfcosim.errors import InputError
from lpfcosim.plant import margins, stability
from lpfcosim.spacecraft import Run
from lpfcosim.worlds import world_of

SCHEMA = "lpf-check/1"

# What `run` takes on a processor of 2024 [s], beside what depends on the world: the command and its workers
# start, a run is set up.
STARTING = 1.4
RUN = 0.05


def check(campaign: Path, console: Console) -> None:
    """Tell what to expect of a campaign, before anything is simulated."""
    plan = loading.load(campaign)
    chosen = fit_settings.settings(plan.fit, f"{campaign}: fit")
    loops: list[margins.Margin] = []
    expected, periods, warnings = None, dict[str, Fit](), []
    try:
        _check_durations(plan)
        if plan.replacements:
            warnings.append("FMUs of other origin: no margins and no forecast, which would be those of ours")
            from lpfcosim.running import fmus  # takes its time, and few campaigns need it

            warnings += fmus.unapproved(plan, {r.model: r.archive for r in plan.replacements})
        else:
            stability.check(*plan.runs)
            loops = margins.margins(plan.runs[0])
            with console.stage("forecast"):
                try:
                    expected = forecast.expected_fit(planned(plan), chosen)
                    periods = angles.expected_periods(turning(plan.runs), expected)
                except forecast.NoneTakesPartError:
                    warnings.append(_why_none(plan))
                except forecast.NoiselessError as error:
                    warnings.append(f"no forecast: {error}")
            warnings += [left_out(name) for name in plan.truth.living]
    except (InputError, fit.errors.InputError) as error:
        raise InputError(f"{campaign}: {error}") from None
    jobs = processors()
    seconds = wall_time(plan, jobs)
    warnings += messages(expected, periods) if expected else []
    told = {
        "schema": SCHEMA,
        "campaign": plan.name,
        "digest": plan.digest,
        "runs": [_run_document(run) for run in plan.runs],
        "duration": sum(map(_duration, plan.runs)),
        "loops": cli_margins.documents(loops),
        "forecast": forecast.document(expected, periods) if expected else None,
        "warnings": warnings,
        "wall_time": round(seconds),
    }
    console.document(json.dumps(told, indent=1, allow_nan=False))
    runs = f"{len(plan.runs)} run{'s' * (len(plan.runs) > 1)}"
    console.say(f"{campaign}: in order; {world_of(plan.runs[0]).name}, {runs}, {_hours(*plan.runs):g} h\n")
    console.show(_runs_table(plan))
    console.say("")
    if loops:
        console.show(cli_margins.table(loops))
        console.say("")
    if expected:
        console.show(table(expected, periods))
        console.say("")
    idle = f"{jobs} idle processors" if jobs > 1 else "an idle processor"
    console.say(f"run: about {_about(seconds)} on {idle}, once the FMUs are built")
    for line in warnings:
        console.note(f"warning: {line}")


def wall_time(plan: Campaign, jobs: int) -> float:
    """Return about how long `run` takes on idle processors, the FMUs being built [s]."""
    world = world_of(plan.runs[0])
    each = [RUN + run.n_samples * world.sample_cost for run in plan.runs]
    simulating = max(max(each), sum(each) / jobs)  # the longest run is not divided
    driven = sum(run.kind == "sysid" for run in plan.runs)  # a noise run alone is fitted in no time
    return STARTING + simulating + world.experiment_cost * driven


def _why_none(plan: Campaign) -> str:
    if any(run.kind == "sysid" for run in plan.runs):
        return "no forecast: no sysid run takes part in the joint fit, one of 6 h or more would"
    return (
        "no sysid run: run will write the telemetry and find nothing to calibrate with; fit it with "
        "--calibration RESULTS.json of an earlier result"
    )


def _check_durations(plan: Campaign) -> None:
    """Refuse runs that the fit would refuse, once they were simulated."""
    driven = {run.experiment for run in plan.runs if run.kind == "sysid"}
    for run in plan.runs:
        if run.experiment in driven and _duration(run) < SHORTEST:
            raise InputError(
                f"run {run.name}: lasts {_duration(run):g} s, expected {SHORTEST:g} s or more, "
                "which the fit needs"
            )


def _duration(run: Run) -> float:
    return run.n_samples / run.fs


def _hours(*runs: Run) -> float:
    return round(sum(map(_duration, runs)) / 3600, 2)


def _about(seconds: float) -> str:
    """Round a time that is not known well."""
    if seconds < 90:
        return f"{seconds if seconds < 20 else 5 * round(seconds / 5):.0f} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _run_document(run: Run) -> dict[str, object]:
    return {
        "run": run.name,
        "experiment": run.experiment,
        "kind": run.kind,
        "t0": run.t0,
        "duration": _duration(run),
        "authority": run.authority.name,
        "alignment_epoch": run.alignment_epoch,
        "injections": len(run.injections),
    }


def _runs_table(plan: Campaign) -> Lines:
    rows = [
        (
            run.name,
            run.kind,
            run.t0[:16].replace("T", " "),
            f"{_hours(run):g}",
            run.authority.name,
            str(run.alignment_epoch),
            str(len(run.injections) or ""),
        )
        for run in plan.runs
    ]
    return Lines(("run", "kind", "start (UTC)", "hours", "authority", "epoch", "injections"), tuple(rows))
