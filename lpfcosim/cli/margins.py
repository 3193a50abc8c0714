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
        found = workflow.margins(campaign)
    except UnavailableError as error:
        name = loading.load(campaign).name
        document = {"schema": workflow.SCHEMA, "campaign": name, "loops": None, "unavailable": error.reason}
        console.document(json.dumps(document, indent=1))
        raise
    console.document(found.to_json())
    console.show(found.table())
