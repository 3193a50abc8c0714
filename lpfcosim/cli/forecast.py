"""The command ``forecast``: the sigmas of the joint fit before anything is simulated."""

import json
from pathlib import Path

from fit.files import atomic
from lpfcosim.cli.console import Console
from lpfcosim.errors import UnavailableError
from lpfcosim.workflows import forecast as workflow
from lpfcosim.workflows import output_paths


def forecast(campaign: Path, out: Path | None, console: Console) -> None:
    """Print the sigmas of the joint fit before anything is simulated."""
    if out is not None:
        output_paths.check_folder(out)
    try:
        with console.stage("forecast"):
            expected = workflow.forecast(campaign)
    except UnavailableError as error:
        document = {"schema": workflow.SCHEMA, "parameters": None, "unavailable": error.reason}
        console.print_json(json.dumps(document, indent=1))
        raise
    text = expected.to_json()
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        atomic.write(out / "forecast.json", text + "\n")
    console.print_json(text)
    for warning in expected.warnings:
        console.warn(warning)
    console.print_table(expected.table())
    console.print_constraints(expected.constraints)
