"""``modelDescription.xml`` for FMI 2.0 and 3.0, and ``buildDescription.xml``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from fit.units import in_base_units
from lpfcosim.modelica.codegen import Layout, settable_until
from lpfcosim.modelica.flat import FlatModel, UnsupportedError
from lpfcosim.modelica.system import Scalar, System

_BASE_UNITS = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol",
               "candela": "cd", "radian": "rad"}  # fmt: skip
_VARIABILITY = {"parameter": "fixed", "calculated": "fixed", "discrete": "discrete"}


@dataclass(frozen=True)
class Description:
    """What both versions of the model description say.

    Attributes
    ----------
    model, system, where : FlatModel, System, Layout
        The model, sorted, with its value references.
    token : str
        GUID (FMI 2.0) or instantiation token (FMI 3.0).
    step : float
        Internal step [s].
    tool : str
        Name of the generator.
    """

    model: FlatModel
    system: System
    where: Layout
    token: str
    step: float
    tool: str

    def fmi3(self) -> str:
        """XML text for FMI 3.0 co-simulation."""
        root = self._root("3.0", "instantiationToken")
        ET.SubElement(
            root,
            "CoSimulation",
            modelIdentifier=self.system.name,
            canGetAndSetFMUState="true",
            canSerializeFMUState="true",
            canHandleVariableCommunicationStepSize="false",
            fixedInternalStepSize=repr(self.step),
        )
        self._common(root)
        variables = ET.SubElement(root, "ModelVariables")
        ET.SubElement(
            variables,
            "Float64",
            name="time",
            valueReference="0",
            causality="independent",
            variability="continuous",
            description="Simulation time",
            unit="s",
        )
        for reference, scalar in enumerate(self.where.order, start=1):
            element = ET.SubElement(variables, "Float64", _identity(scalar, reference))
            element.attrib.update(_value(scalar))
        structure = ET.SubElement(root, "ModelStructure")
        for reference in self._outputs():
            ET.SubElement(structure, "Output", valueReference=str(reference))
        for reference in self._initial_unknowns():
            ET.SubElement(structure, "InitialUnknown", valueReference=str(reference))
        return _text(root)

    def fmi2(self, sources: Sequence[str]) -> str:
        """XML text for FMI 2.0 co-simulation, built from the C files ``sources``."""
        root = self._root("2.0", "guid")
        simulation = ET.SubElement(
            root,
            "CoSimulation",
            modelIdentifier=self.system.name,
            canHandleVariableCommunicationStepSize="false",
            canGetAndSetFMUstate="true",
            canSerializeFMUstate="true",
        )
        files = ET.SubElement(simulation, "SourceFiles")
        for name in sources:
            ET.SubElement(files, "File", name=name)
        self._common(root)
        variables = ET.SubElement(root, "ModelVariables")
        for reference, scalar in enumerate(self.where.order, start=1):
            element = ET.SubElement(variables, "ScalarVariable", _identity(scalar, reference))
            if scalar.kind == "input":
                element.attrib.pop("initial", None)
            ET.SubElement(element, "Real", _value(scalar))
        structure = ET.SubElement(root, "ModelStructure")
        # Without time, the position in the list is the value reference.
        for name, references in (("Outputs", self._outputs()), ("InitialUnknowns", self._initial_unknowns())):
            unknowns = [str(r) for r in references]
            if unknowns:
                group = ET.SubElement(structure, name)
                for index in unknowns:
                    ET.SubElement(group, "Unknown", index=index)
        return _text(root)

    def _root(self, version: str, identity: str) -> ET.Element:
        root = ET.Element("fmiModelDescription", fmiVersion=version, modelName=self.model.name)
        root.set(identity, self.token)
        root.attrib.update(
            description=self.model.description,
            version="1",
            license="BSD-3-Clause",
            generationTool=self.tool,
            variableNamingConvention="structured",
        )
        return root

    def _common(self, root: ET.Element) -> None:
        _units(root, self.model)
        categories = ET.SubElement(root, "LogCategories")
        ET.SubElement(categories, "Category", name="logStatusError", description="Why a call failed")
        ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="100", stepSize=repr(self.step))

    def _outputs(self) -> Iterator[int]:
        return (i for i, s in enumerate(self.where.order, start=1) if s.variable.causality == "output")

    def _initial_unknowns(self) -> Iterator[int]:
        outputs = set(self._outputs())
        for reference, scalar in enumerate(self.where.order, start=1):
            if scalar.kind == "calculated" or (reference in outputs and settable_until(scalar) == 0):
                yield reference


def _identity(scalar: Scalar, reference: int) -> dict[str, str]:
    v = scalar.variable
    kinds = {"parameter": "parameter", "calculated": "calculatedParameter"}
    attributes = {
        "name": scalar.symbol.name,
        "valueReference": str(reference),
        "causality": kinds.get(scalar.kind, v.causality),
        "variability": _VARIABILITY.get(scalar.kind, "continuous"),
    }
    if v.description:
        attributes["description"] = v.description
    if scalar.kind != "input":  # an input is "exact" by definition
        attributes["initial"] = "exact" if settable_until(scalar) else "calculated"
    return attributes


def _value(scalar: Scalar) -> dict[str, str]:
    v = scalar.variable
    attributes = {name: value for name, value in (("quantity", v.quantity), ("unit", v.unit)) if value}
    limits = {"min": scalar.minimum, "max": scalar.maximum, "nominal": scalar.nominal}
    attributes |= {name: repr(value) for name, value in limits.items() if value is not None}
    if settable_until(scalar):
        attributes["start"] = repr(float(scalar.value))
    return attributes


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _units(root: ET.Element, model: FlatModel) -> None:
    units = sorted({"s"} | {v.unit for v in model.variables if v.unit and v.variability != "constant"})
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in units:
        try:
            powers, factor, offset = in_base_units(_pint_spelling(unit))
            exponents = {_BASE_UNITS[name]: power for name, power in powers.items()}
        except (KeyError, ValueError):
            user = next(v for v in model.variables if v.unit == unit)
            raise UnsupportedError(
                f"{model.sources.where(user.span)}: {model.name}: unit '{unit}' of '{user.name}' is not known"
            ) from None
        element = ET.SubElement(definitions, "Unit", name=unit)
        attributes = {k: str(p) for k, p in exponents.items()}
        if factor != 1:
            attributes["factor"] = repr(factor)
        if offset != 0:
            attributes["offset"] = repr(offset)
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


def build_description(identifier: str, sources: Sequence[str]) -> str:
    """XML text that tells an importer of FMI 3.0 how to compile the C files ``sources``."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    group = ET.SubElement(configuration, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=off")
    for name in sources:
        ET.SubElement(group, "SourceFile", name=name)
    return _text(root)
