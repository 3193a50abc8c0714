"""How telemetry was made: what its file states, and what must be the same when a campaign continues."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from lpfcosim.campaign import Campaign
from lpfcosim.execution.checksums import digest
from lpfcosim.models import model_of

MODEL_EQUATIONS = "model equations"  # attribute simulated_by of telemetry that no FMU made
_WAYS = ("through the FMUs", "from the equations of the models")
_LABELS = {"campaign_digest": "version of the campaign", "equations_digest": "version of the models"}


@dataclass(frozen=True)
class Provenance:
    """How the telemetry of a campaign was made.

    Attributes
    ----------
    seed : int
        Of the random numbers.
    version : str
        Of this package.
    campaign, digest : str
        Name and digest of the campaign.
    fmus : mapping of str to str
        SHA-256 of the FMU of each model.
    equations : str
        SHA-256 of the sources of the models whose equations were evaluated, if there are no FMUs.
    """

    seed: int
    version: str
    campaign: str
    digest: str
    fmus: Mapping[str, str] = field(default_factory=dict)
    equations: str = ""

    @classmethod
    def of(cls, campaign: Campaign, fmus: Mapping[str, Path]) -> Provenance:
        """Return the provenance of a campaign that is simulated now, with these FMUs by model, or without."""
        digests = {model: digest(path) for model, path in fmus.items()}
        version = metadata.version("lpfcosim")
        equations = "" if fmus else model_of(campaign.runs[0]).equations_digest
        return cls(campaign.seed, version, campaign.name, campaign.digest, digests, equations)

    def attributes(self) -> dict[str, str | int | float]:
        """Return the attributes that a telemetry file has of it."""
        equations = {"simulated_by": MODEL_EQUATIONS, "equations_digest": self.equations}
        return {
            "seed": self.seed,
            "lpfcosim_version": self.version,
            "campaign": self.campaign,
            "campaign_digest": self.digest,
            **{f"fmu_{model}": sha256 for model, sha256 in self.fmus.items()},
            **(equations if self.equations else {}),
        }

    def mismatch(self, attributes: Mapping[str, Any]) -> str:
        """Return in what the attributes of a file differ from this provenance; empty if in nothing."""
        expected = self.attributes()
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
