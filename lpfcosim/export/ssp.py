"""Write the closed loop of a campaign as SSP, for other tools to open.

SSP 1.0 holds FMUs of FMI 2.0, for it is older than FMI 3.0; SSP 2.0 holds FMI 3.0. What SSP cannot say, the
order of the steps and the step size, stands in the description of the system, and the components are listed
in that order.

The archive has two descriptions. ``SystemStructure.ssd`` runs as it is: a component ahead of the others gives
the loop what comes from outside, and each component has its parameters with it, for there are tools that know
neither connectors nor parameters of a system. ``open.ssd``, a variant, has the signals as inputs and the
channels as outputs of the system, to be a part of something larger.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from lpfcosim.campaign import Campaign
from lpfcosim.cosim import REALS, Interface, Value, read_interfaces_of_runs, stimulus_component
from lpfcosim.errors import InputError
from lpfcosim.export import traceability
from lpfcosim.export.outcome import IRLSResult
from lpfcosim.modelica import build, serialize_xml
from lpfcosim.models import model_of
from lpfcosim.network import endpoint
from lpfcosim.spacecraft import Run

_NAMESPACE = "http://ssp-standard.org/SSP1/SystemStructure"
_SSC, _SSD, _SSV = (f"{{{_NAMESPACE}{part}}}" for part in ("Common", "Description", "ParameterValues"))
for _prefix, _uri in (("ssc", _SSC), ("ssd", _SSD), ("ssv", _SSV)):
    ET.register_namespace(_prefix, _uri.strip("{}"))

_INSIDE = {"1.0": "2.0", "2.0": "3.0"}  # version of FMI by version of SSP


def same_units(interfaces: Sequence[Interface]) -> None:
    """Refuse FMUs that mean different units by the same name: in one archive a name has one meaning."""
    known: dict[str, dict[str, str]] = {}
    for interface in interfaces:
        for name, base in interface.units.items():
            if known.setdefault(name, base) != base:
                raise InputError(f"{interface.archive}: unit '{name}' is not what another FMU means by it")


def fmi(version: str) -> str:
    """Return the version of FMI that goes into a version of SSP."""
    return _INSIDE[version]


def export(
    campaign: Campaign,
    fmus: Mapping[str, Path],
    path: Path,
    version: str = "1.0",
    outcome: IRLSResult | None = None,
) -> Path:
    """Write the closed loop to an ``.ssp`` archive; the same input gives the same bytes.

    Every authority set that an experiment uses gets a file of parameter values,
    ``resources/authority_<name>.ssv``, with all parameters of the first experiment under it; the description
    of the system binds the first of them, to take another is to change that one name. What is bound to the
    components themselves, where a system has none, is that first one; a binding of the system overrides it.

    Parameters
    ----------
    campaign : Campaign
        Gives the authority sets and the other parameters.
    fmus : mapping of str to Path
        The FMU of each component of `SpacecraftModel.components`, of the version of FMI that `fmi` names.
    path : Path
        The archive to write.
    version : str
        Of SSP, ``1.0`` or ``2.0``.
    outcome : IRLSResult, optional
        What came of the campaign. Its results go into the archive; its telemetry is named and stays outside.

    Returns
    -------
    Path
        ``path``.

    Raises
    ------
    InputError
        If an FMU cannot be read, is of another version of FMI, lacks a variable or has an array for it.
    """
    first_runs: dict[str, Run] = {}
    for run in campaign.runs:
        first_runs.setdefault(run.authority.name, run)
    run = next(iter(first_runs.values()))
    interfaces = read_interfaces_of_runs(list(first_runs.values()), fmus)
    _refuse_unfit(interfaces, version)
    signals = model_of(run).signals
    driving = stimulus_component(run, interfaces, build.build([signals], fmi=fmi(version))[signals])
    same_units([driving, *interfaces])
    writer = _Writer(version, interfaces, driving)
    files = {_values_file(name): writer.values(run) for name, run in first_runs.items()}
    files["SystemStructure.ssd"] = writer.structure(campaign.name, run)
    files["open.ssd"] = writer.structure(campaign.name, run, outside=True)
    copied = {_fmu_file(interface.model): interface.archive for interface in (driving, *interfaces)}
    if outcome:
        copied[traceability.RESULTS] = outcome.results
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        root = Path(folder)
        _fill(root, files, copied)
        _save(traceability.task(campaign, root, _execution(run), outcome), root / traceability.FILE)
        build.write_archive(root, path)
    return path


def _refuse_unfit(interfaces: Sequence[Interface], version: str) -> None:
    for interface in interfaces:
        if interface.version != fmi(version):
            raise InputError(
                f"{interface.archive}: is FMI {interface.version}; SSP {version} takes FMI {fmi(version)}"
            )
        user_values = interface.replacement.values if interface.replacement else {}
        for name in (*interface.inputs, *interface.outputs, *user_values):
            if interface.variable(name).shape:
                raise InputError(
                    f"{interface.archive}: '{name}' is an element of an array; "
                    "an exported system connects scalars only"
                )


def _fill(root: Path, written: Mapping[str, ET.Element], copied: Mapping[str, Path]) -> None:
    for folder in ("resources", Path(traceability.FILE).parent):
        (root / folder).mkdir(parents=True)
    for name, element in written.items():
        _save(element, root / name)
    for name, source in copied.items():
        shutil.copyfile(source, root / name)


def _save(element: ET.Element, path: Path) -> None:
    path.write_text(serialize_xml(element), encoding="utf-8", newline="\n")


def _execution(run: Run) -> str:
    return (
        f"Closed loop; step {run.h} s, Gauss-Seidel in the order of the components; in the same "
        "order outputs are passed on once during initialization"
    )


def _typed(variable: Any, value: Value) -> tuple[str, str]:
    """Return the type of a value and how it is written; an enumeration is written by name."""
    if variable.type == "Enumeration" and variable.declaredType is not None:
        names = {int(item.value): item.name for item in variable.declaredType.items}
        return "Enumeration", str(names.get(int(value), value))
    if variable.type in REALS:
        return str(variable.type), repr(float(value))
    return str(variable.type), str(value).lower() if isinstance(value, bool) else str(value)


def _fmu_file(model: str) -> str:
    return f"resources/{model}.fmu"


def _values_file(authority: str) -> str:
    return f"resources/authority_{authority}.ssv"


class _Writer:
    """Writes the parts of an archive.

    Parameters
    ----------
    version : str
        Of SSP.
    interfaces : sequence of Interface
        The FMUs of the loop, in the order of their steps.
    driving : Interface
        The FMU that gives them what comes from outside.
    """

    def __init__(self, version: str, interfaces: Sequence[Interface], driving: Interface) -> None:
        self.version = version
        self.driving = driving
        self.interfaces = interfaces
        self.by_model = {interface.model: interface for interface in interfaces}

    def values(self, run: Run) -> ET.Element:
        """Return the parameters of a run, called ``Model.name``, as seen from the system."""
        prefixed_interfaces = [(f"{i.model}.", i) for i in (self.driving, *self.interfaces)]
        return self._parameter_set(
            run, prefixed_interfaces, f"with what else experiment {run.experiment} sets"
        )

    def structure(self, name: str, run: Run, *, outside: bool = False) -> ET.Element:
        """Describe the loop, driven by a component, or by inputs of the system from outside."""
        root = self._root(f"{_SSD}SystemStructureDescription", name)
        system = ET.SubElement(root, f"{_SSD}System", name=name)
        system.set("description", _execution(run))
        system_connectors = ET.SubElement(system, f"{_SSD}Connectors") if outside else None
        bindings = ET.SubElement(system, f"{_SSD}ParameterBindings")
        ET.SubElement(bindings, f"{_SSD}ParameterBinding", source=_values_file(run.authority.name))
        elements = ET.SubElement(system, f"{_SSD}Elements")
        connections = ET.SubElement(system, f"{_SSD}Connections")
        used: list[str] = []
        if system_connectors is None:
            self._component(elements, self.driving, run, used)
        signals: set[str] = set()
        for interface in self.interfaces:
            self._component(elements, interface, run, used)
            for variable, source in zip(interface.inputs, interface.component.inputs.values(), strict=True):
                end = {"endElement": interface.model, "endConnector": variable}
                signal = not endpoint(source)[0]
                start = f"{self.driving.model}.{source}" if signal and system_connectors is None else source
                self._connect(connections, start, end)
                if system_connectors is not None and signal and source not in signals:
                    signals.add(source)
                    self._connector(system_connectors, source, "input", interface, variable, used)
        for channel, source in model_of(run).record.items():
            model, variable = endpoint(source)
            if system_connectors is not None and model:  # a recorded signal is an input of the system already
                interface = self.by_model[model]
                self._connector(
                    system_connectors, channel, "output", interface, interface.name(variable), used
                )
                self._connect(connections, source, {"endConnector": channel})
        self._units(root, f"{_SSD}Units", used)
        ET.SubElement(root, f"{_SSD}DefaultExperiment", startTime="0.0", stopTime=repr(run.n_samples * run.h))
        return root

    def _root(self, element: str, name: str) -> ET.Element:
        tool = f"lpfcosim {metadata.version('lpfcosim')}"
        return ET.Element(element, version=self.version, name=name, generationTool=tool)

    def _parameter_set(
        self, run: Run, prefixed_interfaces: Sequence[tuple[str, Interface]], description: str
    ) -> ET.Element:
        root = self._root(f"{_SSV}ParameterSet", run.authority.name)
        root.set("description", f"Authority set {run.authority.name} {description}")
        parameters = ET.SubElement(root, f"{_SSV}Parameters")
        used: list[str] = []
        # Noise aside, what comes from outside is the constant that test mass 2 is held against.
        values = {self.driving.model: {"g_2_held": run.dc}, **model_of(run).parameters(run)}
        for prefix, interface in prefixed_interfaces:
            for name, value in interface.parameters(values[interface.model]).items():
                parameter = ET.SubElement(parameters, f"{_SSV}Parameter", name=f"{prefix}{name}")
                kind, text = _typed(interface.variable(name), value)
                element = ET.SubElement(parameter, f"{_SSV}{kind}", value=text)
                unit = interface.unit(name) if kind in REALS else None
                if unit:
                    element.set("unit", unit)
                    used.append(unit)
        self._units(root, f"{_SSV}Units", used)
        return root

    def _component(self, elements: ET.Element, interface: Interface, run: Run, used: list[str]) -> None:
        element = ET.SubElement(
            elements,
            f"{_SSD}Component",
            name=interface.model,
            source=_fmu_file(interface.model),
            implementation="CoSimulation",
        )
        connectors = ET.SubElement(element, f"{_SSD}Connectors")
        for variable in interface.inputs:
            self._connector(connectors, variable, "input", interface, variable, used)
        for variable in interface.outputs:
            self._connector(connectors, variable, "output", interface, variable, used)
        bindings = ET.SubElement(element, f"{_SSD}ParameterBindings")
        binding = ET.SubElement(bindings, f"{_SSD}ParameterBinding")
        inside = ET.SubElement(binding, f"{_SSD}ParameterValues")
        inside.append(self._parameter_set(run, [("", interface)], f"of the {interface.model}"))

    def _connector(
        self, parent: ET.Element, name: str, kind: str, interface: Interface, variable: str, used: list[str]
    ) -> None:
        element = ET.SubElement(parent, f"{_SSD}Connector", name=name, kind=kind)
        if text := interface.variable(variable).description:
            element.set("description", text)
        typed = ET.SubElement(element, f"{_SSC}{interface.variable(variable).type}")
        if unit := interface.unit(variable):
            typed.set("unit", unit)
            used.append(unit)

    def _connect(self, connections: ET.Element, source: str, end: dict[str, str]) -> None:
        model, output = endpoint(source)
        start = {"startElement": model} if model else {}
        if model in self.by_model:
            output = self.by_model[model].name(output)
        ET.SubElement(
            connections, f"{_SSD}Connection", {**start, "startConnector": output if model else source, **end}
        )

    def _units(self, root: ET.Element, tag: str, used: Sequence[str]) -> None:
        if not used:
            return
        definitions = ET.SubElement(root, tag)
        known = {name: base for i in (self.driving, *self.interfaces) for name, base in i.units.items()}
        for name in sorted(set(used)):
            unit = ET.SubElement(definitions, f"{_SSC}Unit", name=name)
            ET.SubElement(unit, f"{_SSC}BaseUnit", known[name])
