"""The commands about a campaign before it is run: ``check``, ``schema``, ``margins``."""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import fit.errors
from fit import settings as fit_settings
from fit.estimate import SHORTEST, divide, forecast
from fit.results import Fit
from fit.tables import Lines
from lpfcosim.campaign import campaign as campaigns
from lpfcosim.cli import study as cli_study
from lpfcosim.cli.common import about
from lpfcosim.cli.console import Console
from lpfcosim.errors import InputError
from lpfcosim.plant import margins as stability_margins
from lpfcosim.plant import stability
from lpfcosim.running import runner
from lpfcosim.spacecraft import Run
from lpfcosim.worlds import world_of

SCHEMA = "lpf-check/1"

# What `run` takes on a processor of 2024 [s], beside what depends on the world: the command and its workers
# start, a run is set up.
STARTING = 5.0
RUN = 0.2


def check(campaign: Path, console: Console) -> None:
    """Tell what to expect of a campaign, before anything is simulated."""
    plan = campaigns.load(campaign)
    chosen = fit_settings.settings(plan.fit, f"{campaign}: fit")
    loops: list[stability_margins.Margin] = []
    expected, warnings = None, []
    try:
        _check_durations(plan)
        if plan.replacements:
            warnings.append("FMUs of other origin: no margins and no forecast, which would be those of ours")
        else:
            for run in plan.runs:
                stability.check(run)
            loops = stability_margins.margins(plan.runs[0])
            with console.stage("forecast"):
                expected = _forecast(plan, chosen)
            if expected is None:
                warnings.append(_why_none(plan))
    except (InputError, fit.errors.InputError) as error:
        raise InputError(f"{campaign}: {error}") from None
    jobs = runner.processors()
    seconds = wall_time(plan, jobs)
    warnings += [w.message for w in (expected.warnings if expected else ())]
    told = {
        "schema": SCHEMA,
        "campaign": plan.name,
        "digest": plan.digest,
        "runs": [_run_document(run) for run in plan.runs],
        "duration": sum(map(_duration, plan.runs)),
        "loops": _loop_documents(loops),
        "forecast": forecast.document(expected) if expected else None,
        "warnings": warnings,
        "wall_time": round(seconds),
    }
    console.document(json.dumps(told, indent=1, allow_nan=False))
    runs = f"{len(plan.runs)} run{'s' * (len(plan.runs) > 1)}"
    console.say(f"{campaign}: in order; {world_of(plan.runs[0]).name}, {runs}, {_hours(*plan.runs):g} h\n")
    console.show(_runs_table(plan))
    console.say("")
    if loops:
        console.say("\n".join([*margin_lines(loops), ""]))
    if expected:
        console.show(cli_study.table(expected))
        console.say("")
    idle = f"{jobs} idle processors" if jobs > 1 else "an idle processor"
    console.say(f"run: about {_about(seconds)} on {idle}, once the FMUs are built")
    for line in warnings:
        console.note(f"warning: {line}")


def print_schema() -> None:
    """Print the JSON Schema of a campaign file; ``lpf-campaign.json`` beside this file holds the same."""
    print(json.dumps(json_schema(), indent=1))


def margins(campaign: Path, console: Console) -> None:
    """Print the margins of every control loop."""
    plan = campaigns.load(campaign)
    with about(campaign):
        stability.check(plan.runs[0])
    loops = stability_margins.margins(plan.runs[0])
    told = {"schema": "lpf-margins/1", "campaign": plan.name, "loops": _loop_documents(loops)}
    console.document(json.dumps(told, indent=1, allow_nan=False))
    console.say("\n".join(margin_lines(loops)))


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file, what the fit reads of it included."""
    found = campaigns.json_schema()
    of_fit = fit_settings.Settings.model_json_schema()
    default = fit_settings.settings().model_dump()
    del of_fit["required"]
    for name, known in of_fit["properties"].items():
        known["default"] = default[name]
    shared = of_fit["properties"]["shared"]
    group = shared.pop("additionalProperties")
    shared |= {"properties": dict.fromkeys(default["shared"], group), "additionalProperties": False}
    found["properties"]["fit"] = of_fit
    for table in ("SineTable", "HalfCosineTable"):
        # its unit depends on the target: in the file a string, to pydantic the number this becomes
        found["$defs"][table]["properties"]["amplitude"]["type"] = "string"
    # a file that extends another has from there what it does not say
    found["anyOf"] = [{"required": ["extends"]}, {"required": found.pop("required")}]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def margin_lines(loops: list[stability_margins.Margin]) -> Iterator[str]:
    """Yield the lines of a table of margins."""
    yield f"{'loop':18s} {'unity gain':>12s} {'phase margin':>13s} {'gain margin':>12s}"
    for m in loops:
        yield f"{m.loop:18s} {1e3 * m.unity_gain:8.4g} mHz {m.phase_margin:9.1f} deg {m.gain_margin:9.1f} dB"


def wall_time(plan: campaigns.Campaign, jobs: int) -> float:
    """Return about how long `run` takes on idle processors, the FMUs being built [s]."""
    world = world_of(plan.runs[0])
    each = [RUN + run.n_samples * world.sample_cost for run in plan.runs]
    simulating = max(max(each), sum(each) / jobs)  # the longest run is not divided
    return STARTING + simulating + world.experiment_cost * len(plan.experiments)


def _forecast(plan: campaigns.Campaign, chosen: fit_settings.Settings) -> Fit | None:
    """Return the joint fit to expect, None if no experiment takes part in one."""
    planned = cli_study.planned(plan)
    taking_part, _, _ = divide([p.experiment for p in planned], chosen)
    return forecast.expected_fit(planned, chosen) if taking_part else None


def _why_none(plan: campaigns.Campaign) -> str:
    if any(run.kind == "sysid" for run in plan.runs):
        return "no forecast: no sysid run takes part in the joint fit, one of 6 h or more would"
    return (
        "no sysid run: run will write the telemetry and find nothing to calibrate with; fit it with "
        "--calibration RESULTS.json of an earlier result"
    )


def _check_durations(plan: campaigns.Campaign) -> None:
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


def _loop_documents(loops: list[stability_margins.Margin]) -> list[dict[str, Any]]:
    """Return margins for JSON; what it has no number for is null, a margin of a gain that is never one."""
    return [
        {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in asdict(loop).items()}
        for loop in loops
    ]


def _runs_table(plan: campaigns.Campaign) -> Lines:
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
