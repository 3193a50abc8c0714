"""Write the closed loop of a campaign as SSP 1.0, for other tools to open.

The FMUs inside are FMI 2.0: SSP 1.0 is older than FMI 3.0, knows neither its types nor its arrays, and the
tools that read it expect FMI 2.0. What SSP cannot say, the order of the steps and the step size, stands in
the description of the system, and the components are listed in that order.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree as ET

from lpfcosim.campaign import Campaign
from lpfcosim.cosim import Interface, interfaces
from lpfcosim.errors import InputError
from lpfcosim.modelica import build
from lpfcosim.network import endpoint
from lpfcosim.spacecraft import Run
from lpfcosim.worlds import world_of

_NAMESPACE = "http://ssp-standard.org/SSP1/SystemStructure"
_SSC, _SSD, _SSV = (f"{{{_NAMESPACE}{part}}}" for part in ("Common", "Description", "ParameterValues"))
for _prefix, _uri in (("ssc", _SSC), ("ssd", _SSD), ("ssv", _SSV)):
    ET.register_namespace(_prefix, _uri.strip("{}"))


def same_units(found: Sequence[Interface]) -> None:
    """Refuse FMUs that mean different units by the same name: in one archive a name has one meaning."""
    known: dict[str, dict[str, str]] = {}
    for interface in found:
        for name, base in interface.units.items():
            if known.setdefault(name, base) != base:
                raise InputError(f"{interface.archive}: unit '{name}' is not what another FMU means by it")


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
        The FMU of each component of `World.components`, FMI 2.0.
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
    first: dict[str, Run] = {}
    for run in campaign.runs:
        first.setdefault(run.authority.name, run)
    found = interfaces(campaign.runs[0], fmus)
    same_units(found)
    for interface in found:
        if interface.version != "2.0":
            raise InputError(f"{interface.archive}: is FMI {interface.version}; SSP 1.0 takes FMI 2.0")
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
        for interface in found:
            shutil.copyfile(interface.archive, root / _fmu_file(interface.model))
        build.write_archive(root, path)
    return path


def _fmu_file(model: str) -> str:
    return f"resources/{model}.fmu"


def _values_file(authority: str) -> str:
    return f"resources/authority_{authority}.ssv"


def _root(element: str, name: str) -> ET.Element:
    tool = f"lpfcosim {metadata.version('lpfcosim')}"
    return ET.Element(element, version="1.0", name=name, generationTool=tool)


def _values(run: Run, found: Sequence[Interface]) -> ET.Element:
    """Parameter set of a run; a parameter is called ``Model.name``, as seen from the system."""
    root = _root(f"{_SSV}ParameterSet", run.authority.name)
    root.set(
        "description", f"Authority set {run.authority.name} with what else experiment {run.experiment} sets"
    )
    parameters = ET.SubElement(root, f"{_SSV}Parameters")
    used = []
    values = world_of(run).parameters(run)
    for interface in found:
        for name, value in interface.parameters(values[interface.model]).items():
            parameter = ET.SubElement(parameters, f"{_SSV}Parameter", name=f"{interface.model}.{name}")
            real = ET.SubElement(parameter, f"{_SSV}Real", value=repr(float(value)))
            if unit := interface.unit(name):
                real.set("unit", unit)
                used.append(unit)
    _units(root, f"{_SSV}Units", used, found)
    return root


def _structure(name: str, run: Run, found: Sequence[Interface]) -> ET.Element:
    root = _root(f"{_SSD}SystemStructureDescription", name)
    system = ET.SubElement(root, f"{_SSD}System", name=name)
    system.set(
        "description",
        f"Closed loop; step {run.h} s, Gauss-Seidel in the order of the components; in the same "
        "order outputs are passed on once during initialization",
    )
    external = ET.SubElement(system, f"{_SSD}Connectors")
    bindings = ET.SubElement(system, f"{_SSD}ParameterBindings")
    ET.SubElement(bindings, f"{_SSD}ParameterBinding", source=_values_file(run.authority.name))
    elements = ET.SubElement(system, f"{_SSD}Elements")
    connections = ET.SubElement(system, f"{_SSD}Connections")
    used = []

    by_model = {interface.model: interface for interface in found}

    def connector(parent: ET.Element, name: str, kind: str, interface: Interface, variable: str) -> None:
        element = ET.SubElement(parent, f"{_SSD}Connector", name=name, kind=kind)
        if text := interface.variable(variable).description:
            element.set("description", text)
        real = ET.SubElement(element, f"{_SSC}Real")
        if unit := interface.unit(variable):
            real.set("unit", unit)
            used.append(unit)

    def connect(source: str, end: dict[str, str]) -> None:
        model, output = endpoint(source)
        start = {"startElement": model} if model else {}
        output = by_model[model].name(output) if model else output
        ET.SubElement(connections, f"{_SSD}Connection", {**start, "startConnector": output, **end})

    signals: set[str] = set()
    for interface in found:
        component, model = interface.component, interface.model
        element = ET.SubElement(
            elements,
            f"{_SSD}Component",
            name=model,
            source=_fmu_file(model),
            implementation="CoSimulation",
        )
        own = ET.SubElement(element, f"{_SSD}Connectors")
        for variable, source in zip(interface.inputs, component.inputs.values(), strict=True):
            connector(own, variable, "input", interface, variable)
            connect(source, {"endElement": model, "endConnector": variable})
            if not endpoint(source)[0] and source not in signals:
                signals.add(source)
                connector(external, source, "input", interface, variable)
        for variable in interface.outputs:
            connector(own, variable, "output", interface, variable)
    for channel, source in world_of(run).record.items():
        model, variable = endpoint(source)
        if model:  # a recorded signal is an input of the system already
            connector(external, channel, "output", by_model[model], by_model[model].name(variable))
            connect(source, {"endConnector": channel})
    _units(root, f"{_SSD}Units", used, found)
    ET.SubElement(root, f"{_SSD}DefaultExperiment", startTime="0.0", stopTime=repr(run.n_samples * run.h))
    return root


def _units(root: ET.Element, tag: str, used: Sequence[str], found: Sequence[Interface]) -> None:
    if not used:
        return
    definitions = ET.SubElement(root, tag)
    known = {name: base for interface in found for name, base in interface.units.items()}
    for name in sorted(set(used)):
        unit = ET.SubElement(definitions, f"{_SSC}Unit", name=name)
        ET.SubElement(unit, f"{_SSC}BaseUnit", known[name])
