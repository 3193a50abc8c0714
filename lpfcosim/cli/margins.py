"""The command ``margins``: how far every control loop is from instability."""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lpfcosim.campaign import loading
from lpfcosim.cli.common import about
from lpfcosim.cli.console import Console
from lpfcosim.plant import margins as loop_margins
from lpfcosim.plant import stability


def margins(campaign: Path, console: Console) -> None:
    """Print the margins of every control loop."""
    plan = loading.load(campaign)
    with about(campaign):
        stability.check(plan.runs[0])
    loops = loop_margins.margins(plan.runs[0])
    told = {"schema": "lpf-margins/1", "campaign": plan.name, "loops": documents(loops)}
    console.document(json.dumps(told, indent=1, allow_nan=False))
    console.say("\n".join(lines(loops)))


def lines(loops: list[loop_margins.Margin]) -> Iterator[str]:
    """Yield the lines of a table of margins."""
    yield f"{'loop':18s} {'unity gain':>12s} {'phase margin':>13s} {'gain margin':>12s}"
    for m in loops:
        yield f"{m.loop:18s} {1e3 * m.unity_gain:8.4g} mHz {m.phase_margin:9.1f} deg {m.gain_margin:9.1f} dB"


def documents(loops: list[loop_margins.Margin]) -> list[dict[str, Any]]:
    """Return margins for JSON; what it has no number for is null, a margin of a gain that is never one."""
    return [
        {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in asdict(loop).items()}
        for loop in loops
    ]
