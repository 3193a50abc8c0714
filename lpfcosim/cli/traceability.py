"""The record of how the results in a folder came about, for SSP traceability."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lpfcosim.errors import InputError

if TYPE_CHECKING:
    from fit.results import Results
    from lpfcosim.campaign import Campaign
    from lpfcosim.export import outcome

_FMU = "fmu_"


def gather(folder: Path, campaign: Campaign) -> outcome.IRLSResult:
    """Read what `folder` holds of a campaign.

    Raises
    ------
    InputError
        If there are no results, a telemetry file is missing or cannot be read, or any is not of this
        campaign as it is now.
    """
    from fit import results
    from fit.telemetry import root_attributes
    from lpfcosim.export import outcome

    path = results.results_file(folder)
    loaded = results.load(path)
    if not loaded.provenance.telemetry:
        raise InputError(f"{path}: provenance.telemetry: expected the names of telemetry files")
    telemetry = {name: path.parent / name for name in loaded.provenance.telemetry}
    recorded: dict[str, Any] = {}
    for file in telemetry.values():
        attributes = root_attributes(file)
        if attributes is None:
            raise InputError(f"{file}: cannot be read, but {path} rests on it")
        if attributes.get("campaign_digest") != campaign.digest:
            raise InputError(f"{file}: was not simulated from this campaign as it is now")
        for key in attributes.keys() & recorded.keys():
            if key.startswith(_FMU) and attributes[key] != recorded[key]:
                model = key.removeprefix(_FMU)
                raise InputError(f"{file}: was simulated with another {model} than other runs")
        recorded |= attributes
    return outcome.IRLSResult(
        results=path,
        telemetry=telemetry,
        flown={
            key.removeprefix(_FMU): str(recorded[key]) for key in sorted(recorded) if key.startswith(_FMU)
        },
        simulated={key: str(recorded[key]) for key in ("lpfcosim_version", "seed") if key in recorded},
        evaluated=_evaluated(loaded),
        verdict=_verdict(loaded),
    )


def _evaluated(loaded: Results) -> dict[str, str]:
    recorded = loaded.provenance
    settings: Mapping[str, object] = {
        **(recorded.settings or {}),
        "f_max": recorded.f_max,
        "window": recorded.window,
    }
    versions = {f"version {name}": version for name, version in (recorded.versions or {}).items()}
    runs = {"joint_runs": recorded.joint_runs, "noise_runs": recorded.noise_runs}
    return {key: _text(value) for key, value in {**settings, **runs, **versions}.items() if value is not None}


def _verdict(loaded: Results) -> dict[str, str]:
    doubts = "; ".join(f"{place}: {warning.code}" for place, warning in loaded.unsound)
    verdict = {"sound": _text(not loaded.unsound)} | ({"doubts": doubts} if doubts else {})
    if loaded.joint:
        codes = sorted({w.code for w in loaded.joint.warnings})
        verdict |= {
            "converged": _text(loaded.joint.converged),
            "chi2": _text(loaded.joint.chi2),
            "dof": _text(loaded.joint.dof),
            "warnings": " ".join(codes),
        }
    return verdict


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)
