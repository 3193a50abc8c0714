"""How telemetry was made: what its file states, and what must be the same when a campaign continues."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from lpfcosim.campaign import Campaign
from lpfcosim.execution.checksums import digest
from lpfcosim.models import model_of

Attributes = Mapping[str, str | int | float]

MODEL_EQUATIONS = "model equations"  # attribute simulated_by of telemetry that no FMU made
_WAYS = ("through the FMUs", "from the equations of the models")
_LABELS = {"campaign_digest": "version of the campaign", "equations_digest": "version of the models"}


def provenance(campaign: Campaign, fmus: Mapping[str, Path]) -> Attributes:
    """Return how the telemetry of a campaign is made that is simulated now, as attributes of its files.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    fmus : mapping of str to Path
        The FMU of each model; without any, the equations of the models are evaluated.
    """
    made_by = {f"fmu_{model}": digest(path) for model, path in fmus.items()}
    equations = model_of(campaign.runs[0]).equations_digest
    return {
        "seed": campaign.seed,
        "lpfcosim_version": metadata.version("lpfcosim"),
        "campaign": campaign.name,
        "campaign_digest": campaign.digest,
        **(made_by or {"simulated_by": MODEL_EQUATIONS, "equations_digest": equations}),
    }


def mismatch(expected: Attributes, attributes: Mapping[str, Any]) -> str:
    """Return in what the attributes of a file differ from a provenance; empty if in nothing."""
    fmus = [name for name in attributes if name.startswith("fmu_")]
    for key in ("simulated_by", *expected, *fmus):
        value, recorded = expected.get(key), attributes.get(key)
        if str(recorded) == str(value):
            continue
        if key == "simulated_by":
            was, now = _WAYS if recorded is None else _WAYS[::-1]
            return f"simulated {was}, now it is {now}"
        if key in ("seed", "lpfcosim_version", "campaign"):
            return f"simulated with {key.removeprefix('lpfcosim_')} {recorded}, now it is {value}"
        return f"simulated with another {_LABELS.get(key) or key.removeprefix('fmu_') + ' FMU'}"
    return ""
