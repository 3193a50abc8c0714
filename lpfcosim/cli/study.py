"""The commands that study a campaign as a whole: ``forecast``."""

import json
from collections.abc import Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import fit.errors
from fit.estimate import Experiment, Planned, document, expected_fit
from fit.estimate import Run as Flown
from fit.paper import FLIGHT
from fit.results import Fit
from fit.settings import settings
from fit.tables import Lines
from fit.telemetry import Telemetry
from lpfcosim.campaign import campaign as campaigns
from lpfcosim.cli.console import Console
from lpfcosim.errors import InputError
from lpfcosim.plant import planning, stability
from lpfcosim.running import telemetry
from lpfcosim.spacecraft import Run


def forecast(campaign: Path, out: Path | None, console: Console) -> None:
    """Tell the sigmas of the joint fit before anything is simulated."""
    if out is not None and out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file, expected a folder for the forecast")
    plan = campaigns.load(campaign)
    chosen = settings(plan.fit, f"{campaign}: fit")
    if plan.replacements:
        console.note("FMUs of other origin are taken to behave as ours do")
    try:
        with console.stage("forecast"):
            expected = expected_fit(planned(plan), chosen)
    except (InputError, fit.errors.InputError) as error:
        raise InputError(f"{campaign}: {error}") from None
    text = json.dumps(document(expected), indent=1, allow_nan=False)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "forecast.json").write_text(text + "\n", encoding="utf-8")
    console.document(text)
    console.show(table(expected))
    for warning in expected.warnings:
        console.note(f"warning: {warning.message}")


def planned(plan: campaigns.Campaign) -> list[Planned]:
    """Return the sysid runs of a campaign as they are expected, without noise and with its cross-spectra.

    Raises
    ------
    InputError
        If a loop is unstable.
    """
    noisy = {run.experiment for run in plan.runs if run.kind == "noise"}
    found = []
    for run in plan.runs:
        if run.kind == "sysid":
            stability.check(run)
            flown = Flown(in_memory(run, planning.response(run)))
            experiment = Experiment(flown, flown if run.experiment in noisy else None)
            found.append(Planned(experiment, partial(planning.cross_spectra, run)))
    return found


def in_memory(run: Run, channels: Mapping[str, np.ndarray[tuple[int], np.dtype[np.float64]]]) -> Telemetry:
    """Return channels at 1 Hz as the telemetry of a run."""
    said = telemetry.attributes(run)
    known = {f.name: said[f.name] for f in fields(Telemetry) if f.name in said}
    n = channels["o_1"].size
    more: Any = {
        **known,
        "path": Path(run.name),
        "fs": planning.RATE,
        "time": np.arange(n) / planning.RATE,
        "channels": channels,
        "units": {},
        "attributes": {name: value for name, value in said.items() if name not in (*known, "schema")},
    }
    return Telemetry(**more)


def table(expected: Fit) -> Lines:
    """Return the sigmas of a forecast beside those of flight."""
    rows = []
    for name, estimate in expected.parameters.items():
        flown = FLIGHT[name].sigma if name in FLIGHT else None
        beside = (f"{flown:.2g}", f"{estimate.sigma / flown:.2g}") if flown else ("", "")
        rows.append((name, estimate.unit, f"{estimate.sigma:.2g}", *beside))
    return Lines(("parameter", "unit", "sigma", "flight sigma", "ratio"), tuple(rows))
