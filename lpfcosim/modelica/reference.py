"""Related files of an FMU by the layered standard FMI-LS-REF: sources, parameters, experiments, digests.

An experiment drives every input with a tone of its own and of its nominal size, for `_STOP` seconds, once for
each set of parameters. Its result is what the FMU gave where it was built, to see whether it does the same
elsewhere. A package says its sets of parameters in ``Resources/authority.json``.
"""

from __future__ import annotations

import csv
import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from lpfcosim.modelica import markup
from lpfcosim.modelica.sources import package_files, resource_files
from lpfcosim.modelica.unit import base
from lpfcosim.modelica.variables import Declared

FOLDER = Path("extra") / "org.fmi-standard.fmi-ls-ref"
_LS = "http://fmi-standard.org/fmi-ls-manifest"
_SSP = "http://ssp-standard.org/SSP1/SystemStructure"
_SSC, _SSV = f"{{{_SSP}Common}}", f"{{{_SSP}ParameterValues}}"
for _prefix, _uri in (("fmi-ls", _LS), ("ssc", _SSC.strip("{}")), ("ssv", _SSV.strip("{}"))):
    ET.register_namespace(_prefix, _uri)
_DESCRIPTION = (
    "Layered Standard providing information on related files included in an FMU."  # as it prescribes
)
_STOP = 10.0  # s
_TOLERANCE = 1e-9  # of the largest value of an output; compilers differ by what they round


@dataclass(frozen=True)
class _Related:
    type: str
    source: str
    role: str
    description: str
    label: str = ""


@dataclass(frozen=True)
class _Set:
    """Values of all parameters; ``name`` is empty for those they start with."""

    name: str
    description: str
    values: Mapping[str, str]

    @property
    def label(self) -> str:
        return f"authority:{self.name}" if self.name else ""

    def file(self, stem: str, suffix: str) -> str:
        return f"{stem}_authority_{self.name}{suffix}" if self.name else f"{stem}{suffix}"


def write(root: Path, package: Path, declared: Sequence[Declared], step: float, *, runs: bool) -> None:
    """Write the related files into the folder of an FMU that is complete but for them.

    Parameters
    ----------
    root : Path
        The folder.
    package : Path
        Of the Modelica sources.
    declared : sequence of Declared
        The variables of the model.
    step : float
        Internal step [s].
    runs : bool
        Whether there is a binary for this machine; without one there is no result.
    """
    folder = root / FOLDER
    sets = _sets(package, declared)
    related = [*_sources(folder, package), *_parameters(folder, declared, sets)]
    if runs:
        related += _experiments(root, folder, declared, sets, step)
    (root / "documentation" / "fmi-ls-ref.html").write_text(_page(related), encoding="utf-8")
    signature = _Related(
        "text/plain", "SHA256SUMS", "signature", "SHA-256 of every other file of the archive"
    )
    manifest = ET.Element(
        "fmiReferences",
        {
            f"{{{_LS}}}fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
            f"{{{_LS}}}fmi-ls-version": "1.0.0-alpha.1",
            f"{{{_LS}}}fmi-ls-description": _DESCRIPTION,
        },
    )
    for r in (*related, signature):
        element = ET.SubElement(
            manifest, "Related", type=r.type, source=r.source, role=r.role, description=r.description
        )
        if r.label:
            ET.SubElement(element, "Label", name=r.label)
    _save(manifest, folder / "fmi-ls-manifest.xml")
    files = sorted(p for p in root.rglob("*") if p.is_file())
    sums = [f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.relative_to(root).as_posix()}" for p in files]
    (folder / "SHA256SUMS").write_text("\n".join(sums) + "\n", encoding="utf-8")


def _sets(package: Path, declared: Sequence[Declared]) -> list[_Set]:
    """Return the parameters as they start and, if the model has any of theirs, the sets of the package."""
    starts = {d.name: d.start for d in declared if d.kind == "parameter"}
    if not starts:
        return [_Set("", "No parameters", {})]
    found = [_Set("", "The parameters as they start", starts)]
    for file in resource_files(package):
        for name, values in json.loads(file.read_text(encoding="utf-8"))["sets"].items():
            told = values.pop("description")
            own = {key: repr(float(value)) for key, value in values.items() if key in starts}
            if own:
                found.append(_Set(name, told, starts | own))
    return found


def _sources(folder: Path, package: Path) -> list[_Related]:
    found = []
    for file in package_files(package):
        inside = Path(package.name) / file.relative_to(package) if package.is_dir() else Path(file.name)
        place = folder / "modelica" / inside
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)
        source = place.relative_to(folder).as_posix()
        found.append(_Related("text/modelica", source, "model", f"Modelica source of {file.stem}"))
    return found


def _parameters(folder: Path, declared: Sequence[Declared], sets: Sequence[_Set]) -> list[_Related]:
    parameters = [d for d in declared if d.kind == "parameter"]
    # Arrays are known to SSP from version 2.0 on.
    version, real = ("2.0", "Float64") if any(d.dims for d in parameters) else ("1.0", "Real")
    found = []
    for own in sets if parameters else ():
        root = ET.Element(
            f"{_SSV}ParameterSet", version=version, name=own.name or "start", description=own.description
        )
        of = ET.SubElement(root, f"{_SSV}Parameters")
        for d in parameters:
            parameter = ET.SubElement(of, f"{_SSV}Parameter", name=d.name)
            value = ET.SubElement(parameter, f"{_SSV}{real}", value=own.values[d.name])
            if d.unit:
                value.set("unit", d.unit)
            for extent in d.dims:
                ET.SubElement(parameter, f"{_SSC}Dimension", size=str(extent))
        units = sorted({d.unit for d in parameters if d.unit})
        group = ET.SubElement(root, f"{_SSV}Units") if units else root
        for unit in units:
            powers, factor, offset = base(unit)
            attributes = {k: str(p) for k, p in powers.items()}
            attributes |= {"factor": repr(factor), "offset": repr(offset)}
            ET.SubElement(ET.SubElement(group, f"{_SSC}Unit", name=unit), f"{_SSC}BaseUnit", attributes)
        name = own.file("parameters", ".ssv") if own.name else "start.ssv"
        _save(root, folder / name)
        found.append(
            _Related("application/x-ssp-parameter-set", name, "parameter", own.description, own.label)
        )
    return found


def _experiments(
    root: Path, folder: Path, declared: Sequence[Declared], sets: Sequence[_Set], step: float
) -> list[_Related]:
    import fmpy

    inputs, outputs = ([d for d in declared if d.causality == c] for c in ("input", "output"))
    if not outputs:
        return []
    time = np.arange(round(_STOP / step) + 1) * step
    driven = np.zeros(len(time), [("time", float), *((d.name, float, d.dims) for d in inputs)])
    driven["time"] = time
    tone = 0
    for d in inputs:
        into = driven[d.name].reshape(len(time), -1)
        for k, element in enumerate(d.elements):
            tone += 1
            size = 1.0 if element.nominal is None else element.nominal
            into[:, k] = size * np.sin(2 * np.pi * (0.05 + 0.01 * tone) * time + tone)
    results = []
    for own in sets:
        # A value at a time is a text that FMPy can read.
        values: dict[str, Any] = dict(own.values)
        try:
            result = fmpy.simulate_fmu(
                str(root), stop_time=_STOP, step_size=step, output_interval=step, start_values=values,
                input=driven if inputs else None, output=[d.name for d in outputs],
            )  # fmt: skip
        # FMPy raises bare exceptions where a model does not run as it starts, or where inputs are scalars and
        # arrays, which it cannot drive together.
        except Exception:
            return []
        results.append(result)
    told = _experiment_file(sets, step, stimuli=bool(inputs))
    _save(told, folder / "smoke-test.exp")
    found = [
        _Related(
            "application/x-ma-hs-experiments",
            "smoke-test.exp",
            "experiment/smoke-test",
            told.attrib["description"],
        )
    ]
    if inputs:
        _table(folder / "input.csv", driven, inputs)
        found.append(_Related("text/csv", "input.csv", "testcase", "The inputs of the experiments"))
    for own, result in zip(sets, results, strict=True):
        name = own.file("result", ".csv")
        _table(folder / name, result, outputs)
        what = f"What the FMU gave where it was built: {own.description}"
        found.append(_Related("text/csv", name, "result", what, own.label))
    return found


def _experiment_file(sets: Sequence[_Set], step: float, *, stimuli: bool) -> ET.Element:
    """Return the experiments in the format that FMI-LS-REF names, ma-hs-experiments."""
    root = ET.Element(
        "Experiments",
        name="smoke test",
        description="Tones into all inputs, set at the beginning of each step; a result may differ by "
        "the tolerance, relative to the largest value of its variable",
    )
    for own in sets:
        experiment = ET.SubElement(
            root, "Experiment", name=own.name or "start", description=own.description, startTime="0.0",
            stopTime=repr(_STOP), tolerance=repr(_TOLERANCE), stepSize=repr(step),
        )  # fmt: skip
        if own.name:
            ET.SubElement(experiment, "Parameters", source=own.file("parameters", ".ssv"))
        if stimuli:
            ET.SubElement(experiment, "Stimuli", type="text/csv", source="input.csv")
        ET.SubElement(experiment, "References", type="text/csv", source=own.file("result", ".csv"))
    return root


def _table(path: Path, values: NDArray[np.void], of: Sequence[Declared]) -> None:
    """Write a CSV file; the elements of an array share a cell, row by row, with blanks between."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        names = ["time", *(d.name for d in of)]
        writer.writerow(names)
        for row in values:
            writer.writerow([" ".join(repr(float(x)) for x in np.ravel(row[name])) for name in names])


def _page(related: Sequence[_Related]) -> str:
    rows = "".join(
        f"<tr><td><code>{escape(r.source)}</code></td><td>{r.role}</td><td>{escape(r.description)}</td></tr>\n"
        for r in related
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>Related files</title></head>\n'
        f"<body>\n<h1>Related files</h1>\n<p>In <code>{FOLDER.as_posix()}</code>, by FMI-LS-REF. The results "
        "show whether an FMU does elsewhere what it did where it was built; they are no proof that its "
        "equations are right. In a table, the elements of an array share a cell, with blanks between.</p>\n"
        f"<table>\n{rows}</table>\n</body>\n</html>\n"
    )


def _save(root: ET.Element, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(markup.text(root), encoding="utf-8")
