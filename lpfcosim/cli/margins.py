"""The command ``margins``: how far every control loop is from instability."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fit.tables import Table
from lpfcosim.campaign import loading
from lpfcosim.cli.common import about
from lpfcosim.cli.console import Console
from lpfcosim.errors import UnavailableError
from lpfcosim.execution import validation
from lpfcosim.linear import margins as loop_margins
from lpfcosim.linear import stability


def margins(campaign: Path, console: Console) -> None:
    """Print the margins of every control loop."""
    plan = loading.load(campaign)
    document = {"schema": "lpf-margins/1", "campaign": plan.name}
    with about(campaign):
        try:
            validation.check_linear_model(plan, "margins are")
        except UnavailableError as error:
            console.document(json.dumps({**document, "loops": None, "unavailable": str(error)}, indent=1))
            raise
        stability.check(plan.runs[0])
    loops = loop_margins.margins(plan.runs[0])
    console.document(json.dumps({**document, "loops": documents(loops)}, indent=1, allow_nan=False))
    console.show(table(loops))


def table(loops: list[loop_margins.Margin]) -> Table:
    """Return a table of margins."""
    rows = [
        (m.loop, f"{1e3 * m.unity_gain:.4g} mHz", f"{m.phase_margin:.1f} deg", f"{m.gain_margin:.1f} dB")
        for m in loops
    ]
    return Table(("loop", "unity gain", "phase margin", "gain margin"), tuple(rows))


def documents(loops: list[loop_margins.Margin]) -> list[dict[str, Any]]:
    """Return margins for JSON; what it has no number for is null, a margin of a gain that is never one."""
    return [
        {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in asdict(loop).items()}
        for loop in loops
    ]
