"""``modelDescription.xml`` of FMI 2.0."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree as ET

import sympy as sp

from fit.units import UnknownUnitError, in_base_units
from lpfcosim.modelica.c_printer import Layout, settable_until
from lpfcosim.modelica.dependencies import Dependencies, initial_dependencies, running_dependencies
from lpfcosim.modelica.flat_model import FlatModel, UnsupportedError
from lpfcosim.modelica.sorted_model import Scalar, SortedModel

_CAUSALITIES = {"parameter": "parameter", "calculated": "calculatedParameter"}
_VARIABILITIES = {"parameter": "fixed", "calculated": "fixed", "discrete": "discrete"}


def print_description(
    flat: FlatModel, model: SortedModel, layout: Layout, *, guid: str, step: float, tool: str
) -> str:
    """Return the XML text of a model for co-simulation.

    Parameters
    ----------
    flat, model, layout : FlatModel, SortedModel, Layout
        The model, and its value references.
    guid : str
        Identifies the binary.
    step : float
        Internal step [s].
    tool : str
        Name of the generator.

    Raises
    ------
    UnsupportedError
        If a unit is not known.
    """
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=flat.name,
        guid=guid,
        description=flat.description,
        version="1",
        license="BSD-3-Clause",
        generationTool=tool,
        variableNamingConvention="structured",
    )
    simulation = ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=model.name,
        canHandleVariableCommunicationStepSize="false",
        canGetAndSetFMUstate="true",
    )
    ET.SubElement(ET.SubElement(simulation, "SourceFiles"), "File", name="all.c")
    _units(root, flat, model)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Why a call failed")
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="100", stepSize=repr(step))
    _variables(root, layout)
    _structure(root, model, layout)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _units(root: ET.Element, flat: FlatModel, model: SortedModel) -> None:
    users = {s.variable.unit: s.variable for s in reversed(model.scalars) if s.variable.unit}
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({"s", *users}):
        try:
            exponents, factor, offset = in_base_units(unit)
        except UnknownUnitError:
            user = users[unit]
            place = flat.sources.location(user.span)
            raise UnsupportedError(
                f"{place}: {flat.name}: unit '{unit}' of '{user.name}' is not known"
            ) from None
        element = ET.SubElement(definitions, "Unit", name=unit)
        attributes = {k: str(p) for k, p in exponents.items()}
        if factor != 1:
            attributes["factor"] = repr(factor)
        if offset != 0:
            attributes["offset"] = repr(offset)
        ET.SubElement(element, "BaseUnit", attributes)


def _variables(root: ET.Element, layout: Layout) -> None:
    variables = ET.SubElement(root, "ModelVariables")
    states = [reference for reference, s in enumerate(layout.order, start=1) if s.kind == "state"]
    for reference, scalar in enumerate(layout.order, start=1):
        variable = scalar.variable
        element = ET.SubElement(
            variables,
            "ScalarVariable",
            name=scalar.symbol.name,
            valueReference=str(reference),
            causality=_CAUSALITIES.get(scalar.kind, variable.causality),
            variability=_VARIABILITIES.get(scalar.kind, "continuous"),
        )
        if variable.description:
            element.set("description", variable.description)
        if scalar.kind != "input":
            element.set("initial", "exact" if settable_until(scalar) else "calculated")
        real = ET.SubElement(element, "Real", _value(scalar))
        if scalar.kind == "rate":
            real.set("derivative", str(states[reference - layout.first_reference("rate")]))


def _value(scalar: Scalar) -> dict[str, str]:
    attributes = {"quantity": scalar.variable.quantity, "unit": scalar.variable.unit}
    for name, limit in (("min", scalar.minimum), ("max", scalar.maximum), ("nominal", scalar.nominal)):
        attributes[name] = None if limit is None else repr(limit)
    if settable_until(scalar):
        attributes["start"] = repr(float(scalar.value))
    return {name: value for name, value in attributes.items() if value}


def _structure(root: ET.Element, model: SortedModel, layout: Layout) -> None:
    """Add what the model computes, and from what."""
    structure = ET.SubElement(root, "ModelStructure")
    outputs = [s for s in layout.order if s.variable.causality == "output"]
    rates = [s for s in layout.order if s.kind == "rate"]
    unknowns = [
        s
        for s in layout.order
        if not settable_until(s) and (s.kind in ("calculated", "state", "rate") or s in outputs)
    ]
    knowns = {s.symbol for s in layout.order if s.kind in ("input", "state")}
    starts = {s.symbol for s in layout.order if settable_until(s)}

    def add(name: str, scalars: Iterable[Scalar], reach: Dependencies, known: set[sp.Symbol]) -> None:
        # Without time among the variables, the position in the list is the value reference.
        for scalar in scalars:
            group = structure.find(name)
            group = ET.SubElement(structure, name) if group is None else group
            dependencies = sorted(layout.reference[s] for s in reach.get(scalar.symbol, frozenset()) & known)
            ET.SubElement(
                group,
                "Unknown",
                index=str(layout.reference[scalar.symbol]),
                dependencies=" ".join(map(str, dependencies)),
            )

    running = running_dependencies(model)
    add("Outputs", outputs, running, knowns)
    add("Derivatives", rates, running, knowns)
    add("InitialUnknowns", unknowns, initial_dependencies(model), starts)
