"""``modelDescription.xml`` and ``buildDescription.xml`` of an FMU."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

import pint

from lpfcosim.modelica.codegen import Layout, settable_until
from lpfcosim.modelica.flat import FlatModel, UnsupportedError
from lpfcosim.modelica.system import Scalar, System

_BASE_UNITS = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol",
               "candela": "cd", "radian": "rad"}  # fmt: skip
_VARIABILITY = {"parameter": "fixed", "calculated": "fixed", "discrete": "discrete"}


def model_description(
    model: FlatModel, system: System, where: Layout, token: str, step: float, tool: str
) -> str:
    """XML text of the model description for FMI 3.0 co-simulation."""
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=model.name,
        instantiationToken=token,
        description=model.description,
        version="1",
        license="BSD-3-Clause",
        generationTool=tool,
        variableNamingConvention="structured",
    )
    ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=system.name,
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        canHandleVariableCommunicationStepSize="false",
        fixedInternalStepSize=repr(step),
    )
    _units(root, model)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Why a call failed")
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="100", stepSize=repr(step))
    variables = ET.SubElement(root, "ModelVariables")
    ET.SubElement(
        variables, "Float64", name="time", valueReference="0", causality="independent",
        variability="continuous", description="Simulation time",
    )  # fmt: skip
    for reference, scalar in enumerate(where.order, start=1):
        variables.append(_variable(scalar, reference))
    structure = ET.SubElement(root, "ModelStructure")
    outputs = [i for i, s in enumerate(where.order, start=1) if s.variable.causality == "output"]
    for reference in outputs:
        ET.SubElement(structure, "Output", valueReference=str(reference))
    for reference, scalar in enumerate(where.order, start=1):
        if scalar.kind == "calculated" or (reference in outputs and settable_until(scalar) == 0):
            ET.SubElement(structure, "InitialUnknown", valueReference=str(reference))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _variable(scalar: Scalar, reference: int) -> ET.Element:
    v = scalar.variable
    element = ET.Element("Float64", name=scalar.symbol.name, valueReference=str(reference))
    causality = {"parameter": "parameter", "calculated": "calculatedParameter"}.get(scalar.kind, v.causality)
    element.set("causality", causality)
    element.set("variability", _VARIABILITY.get(scalar.kind, "continuous"))
    if scalar.kind != "input":  # an input is "exact" by definition
        element.set("initial", "exact" if settable_until(scalar) else "calculated")
    for name, value in (("description", v.description), ("quantity", v.quantity), ("unit", v.unit)):
        if value:
            element.set(name, value)
    if scalar.minimum is not None:
        element.set("min", repr(scalar.minimum))
    if scalar.maximum is not None:
        element.set("max", repr(scalar.maximum))
    if scalar.nominal is not None:
        element.set("nominal", repr(scalar.nominal))
    if settable_until(scalar):
        element.set("start", repr(float(scalar.value)))
    return element


def _units(root: ET.Element, model: FlatModel) -> None:
    units = sorted({v.unit for v in model.variables if v.unit and v.variability != "constant"})
    if not units:
        return
    registry: pint.UnitRegistry[float] = pint.UnitRegistry()
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in units:
        user = next(v for v in model.variables if v.unit == unit)
        try:
            base = registry.Quantity(1.0, _pint_spelling(unit)).to_base_units()
            exponents = {_BASE_UNITS[name]: round(float(str(power))) for name, power in base.unit_items()}
        except (pint.PintError, KeyError, ValueError):
            raise UnsupportedError(
                f"{model.sources.where(user.span)}: {model.name}: unit '{unit}' of '{user.name}' is not known"
            ) from None
        element = ET.SubElement(definitions, "Unit", name=unit)
        attributes = {k: str(p) for k, p in exponents.items()}
        if base.magnitude != 1:
            attributes["factor"] = repr(base.magnitude)
        ET.SubElement(element, "BaseUnit", attributes)


def _pint_spelling(unit: str) -> str:
    """``kg.m/s2`` as Modelica writes it, ``kg*m/s**2`` as pint reads it."""
    if unit == "1":
        return "dimensionless"
    numerator, slash, denominator = unit.partition("/")
    parts = [
        re.sub(r"(?<=[A-Za-z])(-?\d+)", r"**\1", p).replace(".", "*")
        for p in (numerator, denominator.strip("()"))
    ]
    return f"{parts[0]}/({parts[1]})" if slash else parts[0]


def build_description(identifier: str, sources: list[str]) -> str:
    """XML text that tells an importer how to compile the sources."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    group = ET.SubElement(configuration, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=off")
    for name in sources:
        ET.SubElement(group, "SourceFile", name=name)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
