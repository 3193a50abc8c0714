"""How an exported system came about, and how it is to be stepped: SSP Traceability."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree as ET

from lpfcosim.campaign import Campaign

FILE = "extra/org.ssp-standard.ssp-traceability.stmd/SimulationTask.stmd"
_STMD, _STC = (
    f"{{http://ssp-standard.org/SSPTraceability1/{part}}}"
    for part in ("SimulationTaskMetaData", "SSPTraceabilityCommon")
)
for _prefix, _uri in (("stmd", _STMD), ("stc", _STC)):
    ET.register_namespace(_prefix, _uri.strip("{}"))
_TYPES = {
    ".fmu": ("application/x-fmu-sharedlibrary", "model"),
    ".ssv": ("application/x-ssp-parameter-set", "parameter"),
    ".ssd": ("application/x-ssp-definition", "system"),
}  # by the end of a name: MIME type and kind of resource


def task(campaign: Campaign, root: Path, execution: str) -> ET.Element:
    """Return the simulation task meta-data (STMD) of an archive.

    Parameters
    ----------
    campaign : Campaign
        What was exported.
    root : Path
        The folder with all files of the archive but this one.
    execution : str
        How the system is to be stepped.
    """
    files = {p.relative_to(root).as_posix(): p for p in sorted(root.rglob("*")) if p.is_file()}
    digests = {name: hashlib.sha256(p.read_bytes()).hexdigest() for name, p in files.items()}
    tool = f"lpfcosim {metadata.version('lpfcosim')}"
    identity = "".join(f"{digest} {name}\n" for name, digest in digests.items())
    element = ET.Element(
        f"{_STMD}SimulationTaskMetaData", version="1.0", name=campaign.name, generationTool=tool,
        GUID=str(uuid.uuid5(uuid.NAMESPACE_OID, campaign.digest + identity)),
    )  # fmt: skip
    general = ET.SubElement(element, f"{_STMD}GeneralInformation")
    _classify(general, {"campaign": campaign.name, "campaign_sha256": campaign.digest, "tool": tool})
    made = ET.SubElement(element, f"{_STMD}ImplementationPhase")
    for step, suffix, how in (
        (
            "ImplementModel",
            ".fmu",
            "Built from Modelica, with the sources inside, or named by the campaign",
        ),
        ("ImplementParameter", ".ssv", "The parameters of the first experiment under each authority set"),
        ("IntegrateSimulation", ".ssd", "Connected as the loop of the campaign"),
    ):
        work = ET.SubElement(made, f"{_STMD}{step}")
        ET.SubElement(work, f"{_STC}Procedure", description=how)
        output = ET.SubElement(work, f"{_STC}Output")
        for name, digest in digests.items():
            if name.endswith(suffix):
                _classify(_resource(output, name), {"sha256": digest})
    executed = ET.SubElement(ET.SubElement(element, f"{_STMD}ExecutionPhase"), f"{_STMD}ExecuteSimulation")
    _resource(ET.SubElement(executed, f"{_STC}Input"), "SystemStructure.ssd")
    ET.SubElement(executed, f"{_STC}Procedure", description=execution)
    return element


def _resource(parent: ET.Element, name: str) -> ET.Element:
    kind, role = _TYPES[Path(name).suffix]
    above = "../" * FILE.count("/")
    return ET.SubElement(parent, f"{_STC}Resource", kind=role, type=kind, source=f"{above}{name}")


def _classify(parent: ET.Element, entries: Mapping[str, str]) -> None:
    group = ET.SubElement(parent, f"{_STC}Classification", type="org.lpfcosim.provenance")
    for keyword, value in entries.items():
        ET.SubElement(group, f"{_STC}ClassificationEntry", keyword=keyword).text = value
