"""Write the closed loop of a campaign as SSP 1.0, for other tools to open.

The FMUs inside are FMI 2.0: SSP 1.0 is older than FMI 3.0, knows neither its types nor its arrays, and the
tools that read it expect FMI 2.0. What SSP cannot say, the order of the steps and the step size, stands in
the description of the system, and the components are listed in that order.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import fmpy

from lpfcosim import network
from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError
from lpfcosim.modelica import build
from lpfcosim.run import Run

_NAMESPACE = "http://ssp-standard.org/SSP1/SystemStructure"
_SSC, _SSD, _SSV = (f"{{{_NAMESPACE}{part}}}" for part in ("Common", "Description", "ParameterValues"))
for _prefix, _uri in (("ssc", _SSC), ("ssd", _SSD), ("ssv", _SSV)):
    ET.register_namespace(_prefix, _uri.strip("{}"))
_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Interface:
    """What an FMU says of itself.

    Attributes
    ----------
    archive : Path
        The ``.fmu``.
    model : str
        Name of its component.
    version : str
        Version of FMI.
    variables : dict of str to object
        FMPy's records of the variables, by name.
    units : dict of str to dict
        Attributes of the ``BaseUnit`` element of every unit that has one, by name.
    """

    archive: Path
    model: str
    version: str
    variables: dict[str, Any]
    units: dict[str, dict[str, str]]

    def variable(self, name: str) -> Any:
        """Return FMPy's record of a variable; InputError if the FMU has none of that name."""
        if name not in self.variables:
            raise InputError(f"{self.archive}: variable '{name}' is missing; expected of the {self.model}")
        return self.variables[name]

    def unit(self, name: str) -> str | None:
        """Return the unit of a variable, if it has one that the FMU defines in SI."""
        variable = self.variable(name)
        unit = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
        return unit if unit in self.units else None


def endpoint(source: str) -> tuple[str, str]:
    """Split a source of the network into model and output; the model of a signal from outside is empty."""
    model, dot, output = source.partition(".")
    return (model, output) if dot else ("", source)


def interfaces(fmus: Mapping[str, Path]) -> dict[str, Interface]:
    """Read the model descriptions of the FMUs of `network.COMPONENTS`.

    Raises
    ------
    InputError
        If an FMU cannot be read, lacks a variable of the network, or means another unit by the same name.
    """
    found = {c.model: _interface(c.model, fmus[c.model]) for c in network.COMPONENTS}
    known: dict[str, dict[str, str]] = {}
    for component in network.COMPONENTS:
        interface = found[component.model]
        for variable in (*component.inputs, *component.outputs):
            interface.variable(variable)
        for name, base in interface.units.items():
            if known.setdefault(name, base) != base:
                raise InputError(f"{interface.archive}: unit '{name}' is not what another FMU means by it")
    return found


def _interface(model: str, archive: Path) -> Interface:
    try:
        description = fmpy.read_model_description(str(archive))
    except Exception as error:  # FMPy raises bare exceptions for broken archives
        raise InputError(f"{archive}: not a readable FMU: {error}") from None
    units = {u.name: _base(u.baseUnit) for u in description.unitDefinitions if u.baseUnit is not None}
    variables = {v.name: v for v in description.modelVariables}
    return Interface(archive, model, description.fmiVersion, variables, units)


def _base(unit: Any) -> dict[str, str]:
    attributes = {name: str(getattr(unit, name)) for name in _BASE if getattr(unit, name)}
    defaults = {"factor": 1.0, "offset": 0.0}
    return attributes | {n: repr(getattr(unit, n)) for n, v in defaults.items() if getattr(unit, n) != v}


def export(campaign: Campaign, fmus: Mapping[str, Path], path: Path) -> Path:
    """Write the closed loop to an ``.ssp`` archive; the same input gives the same bytes.

    Every authority set that an experiment uses gets a file of parameter values,
    ``resources/authority_<name>.ssv``, with all parameters of the first experiment under it; the description
    of the system binds the first of them, to take another is to change that one name.

    Parameters
    ----------
    campaign : Campaign
        Gives the authority sets and the other parameters.
    fmus : mapping of str to Path
        The FMU of each component of `network.COMPONENTS`, FMI 2.0.
    path : Path
        The archive to write.

    Returns
    -------
    Path
        ``path``.

    Raises
    ------
    InputError
        If an FMU cannot be read, is not FMI 2.0 or lacks a variable.
    """
    found = interfaces(fmus)
    for interface in found.values():
        if interface.version != "2.0":
            raise InputError(f"{interface.archive}: is FMI {interface.version}; SSP 1.0 takes FMI 2.0")
    first: dict[str, Run] = {}
    for run in campaign.runs:
        first.setdefault(run.authority.name, run)
    files = {_values_file(name): _values(run, found) for name, run in first.items()}
    files["SystemStructure.ssd"] = _structure(campaign.name, next(iter(first.values())), found)
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        root = Path(folder)
        (root / "resources").mkdir()
        for file, element in files.items():
            ET.indent(element)
            text = ET.tostring(element, encoding="unicode", xml_declaration=True) + "\n"
            (root / file).write_text(text, encoding="utf-8", newline="\n")
        for model, interface in found.items():
            shutil.copyfile(interface.archive, root / _fmu_file(model))
        build.write_archive(root, path)
    return path


def _fmu_file(model: str) -> str:
    return f"resources/{model}.fmu"


def _values_file(authority: str) -> str:
    return f"resources/authority_{authority}.ssv"


def _root(element: str, name: str) -> ET.Element:
    tool = f"lpfcosim {metadata.version('lpfcosim')}"
    return ET.Element(element, version="1.0", name=name, generationTool=tool)


def _values(run: Run, found: Mapping[str, Interface]) -> ET.Element:
    """Parameter set of a run; a parameter is called ``Model.name``, as seen from the system."""
    root = _root(f"{_SSV}ParameterSet", run.authority.name)
    root.set(
        "description", f"Authority set {run.authority.name} with what else experiment {run.experiment} sets"
    )
    parameters = ET.SubElement(root, f"{_SSV}Parameters")
    used = []
    for model, values in network.parameters(run).items():
        for name, value in values.items():
            parameter = ET.SubElement(parameters, f"{_SSV}Parameter", name=f"{model}.{name}")
            real = ET.SubElement(parameter, f"{_SSV}Real", value=repr(float(value)))
            if unit := found[model].unit(name):
                real.set("unit", unit)
                used.append(unit)
    _units(root, f"{_SSV}Units", used, found)
    return root


def _structure(name: str, run: Run, found: Mapping[str, Interface]) -> ET.Element:
    root = _root(f"{_SSD}SystemStructureDescription", name)
    system = ET.SubElement(root, f"{_SSD}System", name=name)
    system.set(
        "description",
        f"Closed loop along x; step {run.h} s, Gauss-Seidel in the order of the components; in the same "
        "order outputs are passed on once during initialization",
    )
    external = ET.SubElement(system, f"{_SSD}Connectors")
    bindings = ET.SubElement(system, f"{_SSD}ParameterBindings")
    ET.SubElement(bindings, f"{_SSD}ParameterBinding", source=_values_file(run.authority.name))
    elements = ET.SubElement(system, f"{_SSD}Elements")
    connections = ET.SubElement(system, f"{_SSD}Connections")
    used = []

    def connector(parent: ET.Element, name: str, kind: str, model: str, variable: str) -> None:
        element = ET.SubElement(parent, f"{_SSD}Connector", name=name, kind=kind)
        if text := found[model].variable(variable).description:
            element.set("description", text)
        real = ET.SubElement(element, f"{_SSC}Real")
        if unit := found[model].unit(variable):
            real.set("unit", unit)
            used.append(unit)

    def connect(source: str, end: dict[str, str]) -> None:
        model, output = endpoint(source)
        start = {"startElement": model} if model else {}
        ET.SubElement(connections, f"{_SSD}Connection", {**start, "startConnector": output, **end})

    signals: set[str] = set()
    for component in network.COMPONENTS:
        element = ET.SubElement(
            elements,
            f"{_SSD}Component",
            name=component.model,
            source=_fmu_file(component.model),
            implementation="CoSimulation",
        )
        own = ET.SubElement(element, f"{_SSD}Connectors")
        for variable, source in component.inputs.items():
            connector(own, variable, "input", component.model, variable)
            connect(source, {"endElement": component.model, "endConnector": variable})
            if not endpoint(source)[0] and source not in signals:
                signals.add(source)
                connector(external, source, "input", component.model, variable)
        for variable in component.outputs:
            connector(own, variable, "output", component.model, variable)
    for channel, source in network.RECORD.items():
        model, variable = endpoint(source)
        if model:  # a recorded signal is an input of the system already
            connector(external, channel, "output", model, variable)
            connect(source, {"endConnector": channel})
    _units(root, f"{_SSD}Units", used, found)
    ET.SubElement(root, f"{_SSD}DefaultExperiment", startTime="0.0", stopTime=repr(run.n_samples * run.h))
    return root


def _units(root: ET.Element, tag: str, used: Sequence[str], found: Mapping[str, Interface]) -> None:
    if not used:
        return
    definitions = ET.SubElement(root, tag)
    known = {name: base for interface in found.values() for name, base in interface.units.items()}
    for name in sorted(set(used)):
        unit = ET.SubElement(definitions, f"{_SSC}Unit", name=name)
        ET.SubElement(unit, f"{_SSC}BaseUnit", known[name])
