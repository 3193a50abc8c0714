"""How an exported system came about, is to be stepped, and what came of it: SSP Traceability."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree as ET

from lpfcosim.campaign import Campaign
from lpfcosim.export.outcome import IRLSResult

FILE = "extra/org.ssp-standard.ssp-traceability.stmd/SimulationTask.stmd"
RESULTS = "resources/results.json"
_STMD, _STC = (
    f"{{http://ssp-standard.org/SSPTraceability1/{part}}}"
    for part in ("SimulationTaskMetaData", "SSPTraceabilityCommon")
)
_XLINK = "{http://www.w3.org/1999/xlink}"
for _prefix, _uri in (("stmd", _STMD), ("stc", _STC), ("xlink", _XLINK)):
    ET.register_namespace(_prefix, _uri.strip("{}"))
_TYPES = {
    ".fmu": ("application/x-fmu-sharedlibrary", "model"),
    ".ssv": ("application/x-ssp-parameter-set", "parameter"),
    ".ssd": ("application/x-ssp-definition", "system"),
    ".h5": ("application/x-hdf5", "result"),
    ".json": ("application/json", "result"),
}  # by the end of a name: MIME type and kind of resource


def task(campaign: Campaign, root: Path, execution: str, outcome: IRLSResult | None = None) -> ET.Element:
    """Return the simulation task meta-data (STMD) of an archive.

    Parameters
    ----------
    campaign : Campaign
        What was exported.
    root : Path
        The folder with all files of the archive but this one.
    execution : str
        How the system is to be stepped.
    outcome : IRLSResult, optional
        What came of it. Telemetry is named by its place beside the unpacked archive, and by its digest.
    """
    files = {p.relative_to(root).as_posix(): p for p in sorted(root.rglob("*")) if p.is_file()}
    digests = {name: _digest(p) for name, p in files.items()}
    recorded = {name: _digest(p) for name, p in outcome.telemetry.items()} if outcome else {}
    tool = f"lpfcosim {metadata.version('lpfcosim')}"
    identity = "".join(f"{digest} {name}\n" for name, digest in (digests | recorded).items())
    element = ET.Element(
        f"{_STMD}SimulationTaskMetaData", version="1.0.0", name=campaign.name, generationTool=tool,
        GUID=str(uuid.uuid5(uuid.NAMESPACE_OID, campaign.digest + identity)),
    )  # fmt: skip
    general = ET.SubElement(element, f"{_STMD}GeneralInformation")
    _classify(general, {"campaign": campaign.name, "campaign_sha256": campaign.digest, "tool": tool})
    implementation = ET.SubElement(element, f"{_STMD}ImplementationPhase")
    for step, suffix, description in (
        (
            "ImplementModel",
            ".fmu",
            "Built from Modelica, with the sources inside, or named by the campaign",
        ),
        ("ImplementParameter", ".ssv", "The parameters of the first experiment under each authority set"),
        ("IntegrateSimulation", ".ssd", "Connected as the loop of the campaign"),
    ):
        work = ET.SubElement(implementation, f"{_STMD}{step}")
        ET.SubElement(work, f"{_STC}Procedure", description=description)
        output = ET.SubElement(work, f"{_STC}Output")
        for name, digest in digests.items():
            if name.endswith(suffix):
                _classify(_resource(output, name), {"sha256": digest})
    executed = ET.SubElement(ET.SubElement(element, f"{_STMD}ExecutionPhase"), f"{_STMD}ExecuteSimulation")
    _resource(ET.SubElement(executed, f"{_STC}Input"), "SystemStructure.ssd")
    procedure = ET.SubElement(executed, f"{_STC}Procedure", description=execution)
    if outcome:
        _flown(procedure, outcome, set(digests.values()))
        output = ET.SubElement(executed, f"{_STC}Output")
        for k, (name, digest) in enumerate(recorded.items(), start=1):
            resource = _resource(output, name)
            resource.set("id", f"telemetry-{k}")
            _classify(resource, {"sha256": digest})
        _evaluation(element, outcome, digests[RESULTS], len(recorded))
    return element


def _flown(procedure: ET.Element, outcome: IRLSResult, inside: set[str]) -> None:
    """Say with which FMUs the telemetry was simulated, and whether they are those of the archive."""
    foreign_models = sorted(model for model, digest in outcome.flown.items() if digest not in inside)
    known = {
        "fmus_flown": f"not those inside: {', '.join(foreign_models)}" if foreign_models else "those inside"
    }
    digests = {f"fmu_{model}_sha256": digest for model, digest in outcome.flown.items()}
    _classify(procedure, {**outcome.simulated, **known, **digests})


def _evaluation(task: ET.Element, outcome: IRLSResult, digest: str, runs: int) -> None:
    phase = ET.SubElement(task, f"{_STMD}EvaluationPhase")
    step = ET.SubElement(phase, f"{_STMD}EvaluateSimulationResults")
    source = ET.SubElement(step, f"{_STC}Input")
    for k in range(1, runs + 1):
        ET.SubElement(source, f"{_STC}ResourceReference", {f"{_XLINK}href": f"#telemetry-{k}"})
    description = "Fit of the dynamics to the telemetry (lpfcosim fit) with these settings"
    _classify(ET.SubElement(step, f"{_STC}Procedure", description=description), outcome.evaluated)
    _classify(_resource(ET.SubElement(step, f"{_STC}Output"), RESULTS), {"sha256": digest})
    verdict = ET.SubElement(phase, f"{_STMD}DeriveSimulationQualityVerdict")
    _classify(ET.SubElement(verdict, f"{_STC}Output"), outcome.verdict)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _resource(parent: ET.Element, name: str) -> ET.Element:
    kind, role = _TYPES[Path(name).suffix]
    parent_path = "../" * FILE.count("/")
    return ET.SubElement(parent, f"{_STC}Resource", kind=role, type=kind, source=f"{parent_path}{name}")


def _classify(parent: ET.Element, entries: Mapping[str, str]) -> None:
    group = ET.SubElement(parent, f"{_STC}Classification", type="org.lpfcosim.provenance")
    for keyword, value in entries.items():
        ET.SubElement(group, f"{_STC}ClassificationEntry", keyword=keyword).text = value
