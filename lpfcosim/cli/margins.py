"""The command ``margins``: how far every control loop is from instability."""

import json
from pathlib import Path

from lpfcosim.campaign import loading
from lpfcosim.cli.console import Console
from lpfcosim.errors import UnavailableError
from lpfcosim.workflows import margins as workflow


def margins(campaign: Path, console: Console) -> None:
    """Print the margins of every control loop."""
    try:
        loop_margins = workflow.margins(campaign)
    except UnavailableError as error:
        name = loading.load(campaign).name
        document = {"schema": workflow.SCHEMA, "campaign": name, "loops": None, "unavailable": error.reason}
        console.print_json(json.dumps(document, indent=1))
        raise
    console.print_json(loop_margins.to_json())
    console.print_table(loop_margins.table())
