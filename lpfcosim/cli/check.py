"""The command ``check``: what to expect of a campaign before it is run."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fit import settings as fit_settings
from fit.forecasting import expected_euler_fit, expected_fit
from fit.parallel import processors
from fit.results import Fit
from fit.tables import Table
from lpfcosim.campaign import Campaign, loading
from lpfcosim.cli import margins as cli_margins
from lpfcosim.cli.common import about
from lpfcosim.cli.console import Console
from lpfcosim.cli.forecast import left_out, messages, table
from lpfcosim.cli.planned import planned, turning
from lpfcosim.errors import UnavailableError, ours
from lpfcosim.execution import validation
from lpfcosim.linear import margins
from lpfcosim.models import world_of
from lpfcosim.spacecraft import Run

SCHEMA = "lpf-check/1"

# What `run` takes on a processor of 2024 [s], beside what depends on the world: the command and its workers
# start, a run is set up.
STARTING = 1.4
RUN = 0.05


def check(campaign: Path, console: Console) -> None:
    """Validate a campaign and print what to expect of it, before anything is simulated."""
    plan = loading.load(campaign)
    chosen = fit_settings.settings(plan.fit, f"{campaign}: fit")
    jobs = processors()
    with about(campaign), ours():
        found = validation.validate(plan)
        expectation = _expectation(plan, chosen, jobs, console)
    warnings = [*found.warnings, *expectation.warnings]
    loops, expected, periods = expectation.loops, expectation.joint, expectation.periods
    document = {
        "schema": SCHEMA,
        "campaign": plan.name,
        "digest": plan.digest,
        "valid": not found.doubts,
        "runs": [_run_document(run) for run in plan.runs],
        "duration": sum(map(_duration, plan.runs)),
        "loops": None if loops is None else cli_margins.documents(loops),
        "forecast": expected_fit.document(expected, periods) if expected else None,
        "unavailable": expectation.unavailable,
        "warnings": warnings,
        "wall_time": None if expectation.seconds is None else round(expectation.seconds),
    }
    console.document(json.dumps(document, indent=1, allow_nan=False))
    runs = f"{len(plan.runs)} run{'s' * (len(plan.runs) > 1)} {world_of(plan.runs[0]).name}"
    verdict = "doubtful (see the warnings)" if found.doubts else "valid"
    console.say(f"{campaign}: {verdict}: {runs}, {_hours(*plan.runs):g} h\n")
    console.show(_runs_table(plan))
    console.say("")
    if loops:
        console.show(cli_margins.table(loops))
        console.say("")
    if expected:
        console.show(table(expected, periods))
        console.say("")
    if expectation.seconds is not None:
        idle = f"{jobs} idle processors" if jobs > 1 else "an idle processor"
        console.say(f"run: about {_about(expectation.seconds)} on {idle}, once the FMUs are built")
    for line in warnings:
        console.note(f"warning: {line}")


@dataclass(frozen=True)
class _Expectation:
    """What our model of the loop says of a campaign.

    Attributes
    ----------
    loops : list of Margin or None
        None where it does not apply.
    joint : Fit or None
        To be expected; None where there is none.
    periods : mapping of str to Fit
        Euler fits, by inertial period.
    seconds : float or None
        That `run` will take.
    unavailable : str or None
        Why it does not apply.
    warnings : tuple of str
        What to know of it.
    """

    loops: list[margins.Margin] | None
    joint: Fit | None
    periods: Mapping[str, Fit]
    seconds: float | None
    unavailable: str | None
    warnings: tuple[str, ...]


def _expectation(plan: Campaign, chosen: fit_settings.Settings, jobs: int, console: Console) -> _Expectation:
    try:
        validation.check_linear_model(plan, "stability, margins, forecast and wall time are")
    except UnavailableError as error:
        from lpfcosim.execution import fmus  # takes its time, and few campaigns need it

        unapproved = fmus.unapproved(plan, {r.model: r.archive for r in plan.replacements})
        return _Expectation(None, None, {}, None, str(error), (str(error), *unapproved))
    joint, periods, warnings = None, dict[str, Fit](), list[str]()
    loops = margins.margins(plan.runs[0])
    with console.stage("forecast"):
        try:
            joint = expected_fit.expected_fit(planned(plan), chosen)
            periods = expected_euler_fit.expected_periods(turning(plan.runs), joint, chosen.parameters)
        except expected_fit.NoneTakesPartError:
            warnings.append(_why_none(plan))
        except expected_fit.NoiselessError as error:
            warnings.append(f"no forecast: {error}")
    warnings += [left_out(name) for name in plan.truth.living]
    warnings += messages(joint, periods) if joint else []
    return _Expectation(loops, joint, periods, wall_time(plan, jobs), None, tuple(warnings))


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


def _runs_table(plan: Campaign) -> Table:
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
    return Table(("run", "kind", "start (UTC)", "hours", "authority", "epoch", "injections"), tuple(rows))
