"""The command ``forecast``: the sigmas of the joint fit before anything is simulated."""

import json
from pathlib import Path

import fit.errors
from fit.estimate import forecast as forecasts
from fit.paper import FLIGHT
from fit.results import Fit
from fit.settings import settings
from fit.tables import Lines
from lpfcosim.campaign import loading
from lpfcosim.cli.common import check_folder
from lpfcosim.cli.console import Console
from lpfcosim.cli.planned import planned
from lpfcosim.errors import InputError


def forecast(campaign: Path, out: Path | None, console: Console) -> None:
    """Tell the sigmas of the joint fit before anything is simulated."""
    if out is not None:
        check_folder(out)
    plan = loading.load(campaign)
    chosen = settings(plan.fit, f"{campaign}: fit")
    if plan.replacements:
        console.note("FMUs of other origin are taken to behave as ours do")
    for name in plan.truth.living:
        console.note(f"warning: {left_out(name)}")
    try:
        with console.stage("forecast"):
            gains = dict.fromkeys(("lambda_1", "lambda_2"), plan.truth.lambda_scatter)
            expected = forecasts.expected_fit(planned(plan), chosen, gains)
    except (InputError, fit.errors.InputError) as error:
        raise InputError(f"{campaign}: {error}") from None
    text = json.dumps(forecasts.document(expected), indent=1, allow_nan=False)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "forecast.json").write_text(text + "\n", encoding="utf-8")
    console.document(text)
    console.show(table(expected))
    for warning in expected.warnings:
        console.note(f"warning: {warning.message}")


def left_out(name: str) -> str:
    """Say of a truth, by its name, that a forecast knows nothing of it."""
    return f"truth.{name}: the forecast leaves out gains that change within a run"


def table(expected: Fit) -> Lines:
    """Return the sigmas of a forecast beside those of flight."""
    rows = []
    for name, estimate in expected.parameters.items():
        flown = FLIGHT[name].sigma if name in FLIGHT else None
        beside = (f"{flown:.2g}", f"{estimate.sigma / flown:.2g}") if flown else ("", "")
        rows.append((name, estimate.unit, f"{estimate.sigma:.2g}", *beside))
    return Lines(("parameter", "unit", "sigma", "flight sigma", "ratio"), tuple(rows))
