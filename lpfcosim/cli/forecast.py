"""The command ``forecast``: the sigmas of the joint fit before anything is simulated."""

import json
from collections.abc import Mapping
from pathlib import Path

from fit.forecasting import expected_euler_fit
from fit.forecasting import expected_fit as forecasts
from fit.parameters import FLIGHT, misalignments
from fit.results import FIXED, Fit
from fit.settings import settings
from fit.tables import Table
from lpfcosim.campaign import loading
from lpfcosim.cli.common import about, check_folder
from lpfcosim.cli.console import Console
from lpfcosim.cli.planned import planned, turning
from lpfcosim.errors import UnavailableError, ours
from lpfcosim.execution import validation
from lpfcosim.messages import grouped


def forecast(campaign: Path, out: Path | None, console: Console) -> None:
    """Print the sigmas of the joint fit before anything is simulated."""
    if out is not None:
        check_folder(out)
    plan = loading.load(campaign)
    chosen = settings(plan.fit, f"{campaign}: fit")
    with about(campaign), ours():
        try:
            validation.check_linear_model(plan, "a forecast is", "lpfcosim run gives the sigmas of its fit")
        except UnavailableError as error:
            document = {"schema": forecasts.SCHEMA, "parameters": None, "unavailable": str(error)}
            console.document(json.dumps(document, indent=1))
            raise
        for line in (*validation.validate(plan).doubts, *map(left_out, plan.truth.living)):
            console.note(f"warning: {line}")
        with console.stage("forecast"):
            gains = dict.fromkeys(("lambda_1", "lambda_2"), plan.truth.lambda_scatter)
            expected = forecasts.expected_fit(planned(plan), chosen, gains)
            periods = expected_euler_fit.expected_periods(turning(plan.runs), expected, chosen.parameters)
    text = json.dumps(forecasts.document(expected, periods), indent=1, allow_nan=False)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "forecast.json").write_text(text + "\n", encoding="utf-8")
    console.document(text)
    console.show(table(expected, periods))
    for message in messages(expected, periods):
        console.note(f"warning: {message}")


def left_out(name: str) -> str:
    """Say of a truth, by its name, that a forecast knows nothing of it."""
    return f"truth.{name}: the forecast leaves out gains that change within a run"


def messages(expected: Fit, periods: Mapping[str, Fit]) -> list[str]:
    """Return what to know of a joint fit to expect, and of the Euler fits of its inertial periods."""
    of_periods = [(period, w.message) for period, of in periods.items() for w in of.warnings]
    return [*(w.message for w in expected.warnings), *grouped(of_periods, "inertial period")]


def table(expected: Fit, periods: Mapping[str, Fit]) -> Table:
    """Return the sigmas of a forecast beside those of flight, last those of the angles by inertial period."""
    flown = {name: parameter.sigma for name, parameter in FLIGHT.items()}
    told = dict(expected.parameters)
    for period, of in periods.items():
        told |= {f"{name}_{period}": estimate for name, estimate in of.parameters.items()}
        flown |= {f"{p.name}_{period}": p.sigma for p in misalignments(period) if p.flown}
    rows = []
    for name, estimate in told.items():
        sigma = flown.get(name)
        beside = (f"{sigma:.2g}", f"{estimate.sigma / sigma:.2g}") if sigma else ("", "")
        if estimate.fixed:
            beside = ("", "")
        rows.append((name, estimate.unit, FIXED if estimate.fixed else f"{estimate.sigma:.2g}", *beside))
    return Table(("parameter", "unit", "sigma", "flight sigma", "ratio"), tuple(rows))
