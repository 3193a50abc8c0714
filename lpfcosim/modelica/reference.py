"""Related files of an FMU by the layered standard FMI-LS-REF: sources, parameters, a run, digests.

The experiment drives every input with a tone of its own and of its nominal size, for `_STOP` seconds. Its
result is what the FMU gave where it was built, to see whether it does the same elsewhere.
"""

from __future__ import annotations

import csv
import hashlib
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from lpfcosim.modelica import markup
from lpfcosim.modelica.flat import package_files
from lpfcosim.modelica.system import Scalar, System
from lpfcosim.modelica.unit import base

FOLDER = Path("extra") / "org.fmi-standard.fmi-ls-ref"
_LS = "http://fmi-standard.org/fmi-ls-manifest"
_SSP = "http://ssp-standard.org/SSP1/SystemStructure"
_SSC, _SSV = f"{{{_SSP}Common}}", f"{{{_SSP}ParameterValues}}"
_Related = tuple[str, str, str, str]  # type, source, role, description
for _prefix, _uri in (("fmi-ls", _LS), ("ssc", _SSC.strip("{}")), ("ssv", _SSV.strip("{}"))):
    ET.register_namespace(_prefix, _uri)
_DESCRIPTION = (
    "Layered Standard providing information on related files included in an FMU."  # as it prescribes
)
_STOP = 10.0  # s
_TOLERANCE = 1e-9  # of the largest value of an output; compilers differ by what they round


def write(root: Path, package: Path, system: System, step: float, *, runs: bool) -> None:
    """Write the related files into the folder of an FMU that is complete but for them.

    Parameters
    ----------
    root : Path
        The folder.
    package : Path
        Of the Modelica sources.
    system : System
        The model.
    step : float
        Internal step [s].
    runs : bool
        Whether there is a binary for this machine; without one there is no result.
    """
    folder = root / FOLDER
    related = [*_sources(folder, package), *_parameters(folder, system)]
    if runs:
        related += _experiment(root, folder, system, step)
    (root / "documentation" / "fmi-ls-ref.html").write_text(_page(related), encoding="utf-8")
    signature = ("text/plain", "SHA256SUMS", "signature", "SHA-256 of every other file of the archive")
    manifest = ET.Element(
        "fmiReferences",
        {
            f"{{{_LS}}}fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
            f"{{{_LS}}}fmi-ls-version": "1.0.0-alpha.1",
            f"{{{_LS}}}fmi-ls-description": _DESCRIPTION,
        },
    )
    for kind, source, role, description in (*related, signature):
        ET.SubElement(
            manifest, "Related", {"type": kind, "source": source, "role": role, "description": description}
        )
    _save(manifest, folder / "fmi-ls-manifest.xml")
    files = sorted(p for p in root.rglob("*") if p.is_file())
    sums = [f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.relative_to(root).as_posix()}" for p in files]
    (folder / "SHA256SUMS").write_text("\n".join(sums) + "\n", encoding="utf-8")


def _sources(folder: Path, package: Path) -> list[_Related]:
    found = []
    for file in package_files(package):
        inside = Path(package.name) / file.relative_to(package) if package.is_dir() else Path(file.name)
        place = folder / "modelica" / inside
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)
        found.append(
            (
                "text/modelica",
                place.relative_to(folder).as_posix(),
                "model",
                f"Modelica source of {file.stem}",
            )
        )
    return found


def _parameters(folder: Path, system: System) -> list[_Related]:
    parameters = [s for s in system.scalars if s.kind == "parameter"]
    if not parameters:
        return []
    root = ET.Element(
        f"{_SSV}ParameterSet", version="1.0", name="start", description="The parameters as they start"
    )
    of = ET.SubElement(root, f"{_SSV}Parameters")
    for s in parameters:
        value = ET.SubElement(ET.SubElement(of, f"{_SSV}Parameter", name=s.symbol.name), f"{_SSV}Real")
        value.attrib.update(
            {"value": repr(float(s.value)), **({"unit": s.variable.unit} if s.variable.unit else {})}
        )
    units = ET.SubElement(root, f"{_SSV}Units")
    for unit in sorted({s.variable.unit for s in parameters if s.variable.unit}):
        powers, factor, offset = base(unit)
        attributes = {k: str(p) for k, p in powers.items()} | {"factor": repr(factor), "offset": repr(offset)}
        ET.SubElement(ET.SubElement(units, f"{_SSC}Unit", name=unit), f"{_SSC}BaseUnit", attributes)
    if not len(units):
        root.remove(units)
    _save(root, folder / "start.ssv")
    return [("application/x-ssp-parameter-set", "start.ssv", "parameter", "The parameters as they start")]


def _experiment(root: Path, folder: Path, system: System, step: float) -> list[_Related]:
    import fmpy

    inputs = [s for s in system.scalars if s.variable.causality == "input"]
    outputs = [s for s in system.scalars if s.variable.causality == "output"]
    if not outputs:
        return []
    time = np.arange(round(_STOP / step) + 1) * step
    driven = np.zeros(len(time), [("time", float), *((s.symbol.name, float) for s in inputs)])
    driven["time"] = time
    for k, s in enumerate(inputs, start=1):
        size = 1.0 if s.nominal is None else s.nominal
        driven[s.symbol.name] = size * np.sin(2 * np.pi * (0.05 + 0.01 * k) * time + k)
    try:
        result = fmpy.simulate_fmu(
            str(root), stop_time=_STOP, step_size=step, output_interval=step,
            input=driven if inputs else None, output=[s.symbol.name for s in outputs],
        )  # fmt: skip
    except Exception:  # FMPy raises bare exceptions where a model does not run as it starts
        return []
    _table(folder / "input.csv", driven, inputs)
    _table(folder / "result.csv", result, outputs)
    experiment = {
        "startTime": 0.0, "stopTime": _STOP, "stepSize": step, "input": "input.csv", "result": "result.csv",
        "tolerance": _TOLERANCE,
        "description": "Inputs are set at the beginning of each step; a result may differ by the tolerance, "
        "relative to the largest value of its column",
    }  # fmt: skip
    (folder / "experiment.json").write_text(json.dumps(experiment, indent=1) + "\n", encoding="utf-8")
    return [
        ("application/json", "experiment.json", "experiment/smoke-test", "Tones into all inputs"),
        ("text/csv", "input.csv", "testcase", "The inputs of the experiment"),
        ("text/csv", "result.csv", "result", "What the FMU gave where it was built"),
    ]


def _table(path: Path, values: NDArray[np.void], of: Sequence[Scalar]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        names = ["time", *(s.symbol.name for s in of)]
        writer.writerow(names)
        writer.writerows([repr(float(row[name])) for name in names] for row in values)


def _page(related: Sequence[_Related]) -> str:
    rows = "".join(
        f"<tr><td><code>{source}</code></td><td>{role}</td><td>{told}</td></tr>\n"
        for _, source, role, told in related
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>Related files</title></head>\n'
        f"<body>\n<h1>Related files</h1>\n<p>In <code>{FOLDER.as_posix()}</code>, by FMI-LS-REF. The result "
        "shows whether an FMU does elsewhere what it did where it was built; it is no proof that its "
        f"equations are right.</p>\n<table>\n{rows}</table>\n</body>\n</html>\n"
    )


def _save(root: ET.Element, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(markup.text(root), encoding="utf-8")
