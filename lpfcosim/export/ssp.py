"""Write the closed loop of a campaign as SSP 1.0, for other tools to open.

SSP 1.0 holds FMUs of FMI 2.0. What SSP cannot state, the order of the steps and the step size, stands in the
description of the system, and the components are listed in that order. Inputs that no component feeds (noise
and injections) keep the values of the parameter set.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from lpfcosim.campaign import Campaign
from lpfcosim.cosim import REALS, Interface, Value, read_interfaces_of_runs
from lpfcosim.errors import InputError
from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.network import endpoint
from lpfcosim.spacecraft import Run


def _check(interfaces: Sequence[Interface]) -> None:
    """Refuse other versions of FMI, and different units of one name: in one archive it has one meaning."""
    known: dict[str, dict[str, str]] = {}
    for interface in interfaces:
        if interface.version != "2.0":
            raise InputError(f"{interface.archive}: is FMI {interface.version}; SSP 1.0 takes FMI 2.0")
        for name, base in interface.units.items():
            if known.setdefault(name, base) != base:
                raise InputError(f"{interface.archive}: unit '{name}' is not what another FMU means by it")


def export(campaign: Campaign, fmus: Mapping[str, Path], path: Path) -> Path:
    """Write the closed loop to an ``.ssp`` archive; the same input gives the same bytes.

    Every authority set that an experiment uses gets a file of parameter values,
    ``resources/authority_<name>.ssv``, with all parameters of the first experiment under it. The description
    of the system binds the first of them; to take another, change that name. Each component has its part of
    the first set as well, for tools that do not read parameters of a system.

    Parameters
    ----------
    campaign : Campaign
        Gives the authority sets and the other parameters.
    fmus : mapping of str to Path
        The FMU of each component of `SpacecraftModel.components`, FMI 2.0.
    path : Path
        The archive to write.

    Returns
    -------
    Path
        ``path``.

    Raises
    ------
    InputError
        If pyssp-standard is not installed, or an FMU cannot be read, is of another version of FMI, or lacks
        a variable.
    """
    runs: dict[str, Run] = {}
    for run in campaign.runs:
        runs.setdefault(run.authority.name, run)
    interfaces = read_interfaces_of_runs(list(runs.values()), fmus)
    _check(interfaces)
    try:
        from pyssp_standard.ssd import SSD
        from pyssp_standard.ssv import SSV
    except ImportError:
        raise InputError("SSP needs pyssp-standard: pip install 'lpfcosim[build]'") from None
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        root = Path(folder)
        (root / "resources").mkdir()
        for interface in interfaces:
            shutil.copyfile(interface.archive, root / _fmu_file(interface))
        for name, run in runs.items():
            with SSV(root / _values_file(name), mode="w") as file:
                file.ssv_elem.name = name
                for interface in interfaces:
                    _fill_values(file.ssv_elem, run, interface, prefix=f"{interface.model}.")
        with SSD(root / "SystemStructure.ssd", mode="w") as structure:
            _fill_structure(structure, campaign.name, next(iter(runs.values())), interfaces)
        build.write_archive(root, path)
    return path


def _fmu_file(interface: Interface) -> str:
    return f"resources/{interface.model}.fmu"


def _values_file(authority: str) -> str:
    return f"resources/authority_{authority}.ssv"


def _fill_structure(structure: Any, name: str, run: Run, interfaces: Sequence[Interface]) -> None:
    """Describe components, connections and units in an `SSD` of pyssp-standard."""
    from pyssp_standard.ssd import Connection, ParameterBinding, System

    structure.name, structure.version = name, "1.0"
    structure.base_element.description = (
        f"Closed loop; step {run.h} s, Gauss-Seidel in the order of the components; in the same "
        "order outputs are passed on once during initialization"
    )
    structure.top_level_metadata.generationTool = f"lpfcosim {metadata.version('lpfcosim')}"
    structure.top_level_metadata.generationDateAndTime = ""  # the same input gives the same bytes
    system = structure.system = System(name=name)
    system.parameter_bindings = [ParameterBinding(source=_values_file(run.authority.name))]
    by_model = {interface.model: interface for interface in interfaces}
    for interface in interfaces:
        system.elements.append(_component(interface, run))
        for variable, source in zip(interface.inputs, interface.component.inputs.values(), strict=True):
            model, output = endpoint(source)
            if model:
                system.connections.append(
                    Connection(
                        start_element=model,
                        start_connector=by_model[model].name(output),
                        end_element=interface.model,
                        end_connector=variable,
                    )
                )
    for interface in interfaces:
        _add_units(structure.units, interface, [*interface.inputs, *interface.outputs])


def _component(interface: Interface, run: Run) -> Any:
    from pyssp_standard.common_content_ssc import TypeReal
    from pyssp_standard.ssd import Component, Connector, ParameterBinding
    from pyssp_standard.ssv import SSVElem

    component = Component()
    component.name, component.implementation = interface.model, "CoSimulation"
    component.source = _fmu_file(interface)
    component.connectors = [
        Connector(name=name, kind=kind, type_=TypeReal(interface.unit(name)))
        for kind, names in (("input", interface.inputs), ("output", interface.outputs))
        for name in names
    ]
    component.parameter_bindings = [ParameterBinding(ssv=SSVElem(name=run.authority.name))]
    _fill_values(component.parameter_bindings[0].ssv, run, interface)
    return component


def _fill_values(values: Any, run: Run, interface: Interface, prefix: str = "") -> None:
    """Add the parameters of an FMU and their units to an `SSVElem`, with a prefix to their names."""
    from pyssp_standard.parameter_types import ParameterType
    from pyssp_standard.ssv import Parameter

    # Noise aside, what comes from outside is the constant that test mass 2 is held against.
    inputs = zip(interface.inputs, interface.component.inputs.values(), strict=True)
    signals = {variable: run.dc for variable, source in inputs if source == "g_2"}
    parameters = interface.parameters(model_of(run).parameters(run)[interface.model])
    for name, value in {**signals, **parameters}.items():
        kind, text = _typed(interface.variable(name), value)
        unit = interface.unit(name) if kind in REALS else None
        attributes = {"value": text} | ({"unit": unit} if unit else {})
        typed = ParameterType(kind, attributes)
        typed.parameter = attributes  # it adds attributes that are None, and cannot write them
        values.parameters.append(Parameter(name=f"{prefix}{name}", type_name=kind, type_value=typed))
        _add_units(values.units, interface, [name] if unit else [])


def _add_units(units: Any, interface: Interface, names: Sequence[str]) -> None:
    from pyssp_standard.unit import BaseUnit, Unit

    for unit in filter(None, map(interface.unit, names)):
        units.add_unit(Unit(unit, BaseUnit(interface.units[unit])))


def _typed(variable: Any, value: Value) -> tuple[str, str]:
    """Return the type of a value and how it is written; an enumeration is written by name."""
    if variable.type == "Enumeration" and variable.declaredType is not None:
        names = {int(item.value): item.name for item in variable.declaredType.items}
        return "Enumeration", str(names.get(int(value), value))
    if variable.type in REALS:
        return str(variable.type), repr(float(value))
    return str(variable.type), str(value).lower() if isinstance(value, bool) else str(value)
