"""What came of a campaign, gathered from a folder of results."""

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
    found = results.load(path)
    if not found.provenance.telemetry:
        raise InputError(f"{path}: provenance.telemetry: expected the names of telemetry files")
    telemetry = {name: path.parent / name for name in found.provenance.telemetry}
    said: dict[str, Any] = {}
    for file in telemetry.values():
        attributes = root_attributes(file)
        if attributes is None:
            raise InputError(f"{file}: cannot be read, but {path} rests on it")
        if attributes.get("campaign_digest") != campaign.digest:
            raise InputError(f"{file}: was not simulated from this campaign as it is now")
        for key in attributes.keys() & said.keys():
            if key.startswith(_FMU) and attributes[key] != said[key]:
                model = key.removeprefix(_FMU)
                raise InputError(f"{file}: was simulated with another {model} than other runs")
        said |= attributes
    return outcome.IRLSResult(
        results=path,
        telemetry=telemetry,
        flown={key.removeprefix(_FMU): str(said[key]) for key in sorted(said) if key.startswith(_FMU)},
        simulated={key: str(said[key]) for key in ("lpfcosim_version", "seed") if key in said},
        evaluated=_evaluated(found),
        verdict=_verdict(found),
    )


def _evaluated(found: Results) -> dict[str, str]:
    said = found.provenance
    chosen: Mapping[str, object] = {**(said.settings or {}), "f_max": said.f_max, "window": said.window}
    versions = {f"version {name}": version for name, version in (said.versions or {}).items()}
    runs = {"joint_runs": said.joint_runs, "noise_runs": said.noise_runs}
    return {key: _text(value) for key, value in {**chosen, **runs, **versions}.items() if value is not None}


def _verdict(found: Results) -> dict[str, str]:
    doubts = "; ".join(f"{place}: {warning.code}" for place, warning in found.unsound)
    verdict = {"sound": _text(not found.unsound)} | ({"doubts": doubts} if doubts else {})
    if found.joint:
        codes = sorted({w.code for w in found.joint.warnings})
        verdict |= {
            "converged": _text(found.joint.converged),
            "chi2": _text(found.joint.chi2),
            "dof": _text(found.joint.dof),
            "warnings": " ".join(codes),
        }
    return verdict


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)
