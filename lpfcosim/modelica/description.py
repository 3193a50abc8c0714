"""``modelDescription.xml`` for FMI 2.0 and 3.0, and ``buildDescription.xml``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import sympy as sp

from lpfcosim.modelica import markup
from lpfcosim.modelica.codegen import Layout, settable_until
from lpfcosim.modelica.evaluate import TIME
from lpfcosim.modelica.flat import FlatModel, UnsupportedError
from lpfcosim.modelica.sensitivity import Dependence, Sensitivity
from lpfcosim.modelica.system import Scalar, System
from lpfcosim.modelica.unit import base

# Kinds of knowns after initialization: those of FMI 2.0, and what FMI 3.0 counts as well.
_KNOWNS = {"2.0": ("input", "state"), "3.0": ("input", "state", "discrete", "parameter")}


@dataclass(frozen=True)
class Description:
    """What both versions of the model description say.

    Attributes
    ----------
    model, system, sensitivity, where : FlatModel, System, Sensitivity, Layout
        The model, sorted, with what follows from what, and its value references.
    token : str
        GUID (FMI 2.0) or instantiation token (FMI 3.0).
    step : float
        Internal step [s].
    tool : str
        Name of the generator.
    """

    model: FlatModel
    system: System
    sensitivity: Sensitivity
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
            providesDirectionalDerivatives="true",
            providesAdjointDerivatives="true",
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
            element = ET.SubElement(variables, "Float64", self._identity(scalar, reference))
            element.attrib.update(_value(scalar))
            if scalar.kind == "rate":
                element.set("derivative", str(self._state(reference)))
        structure = ET.SubElement(root, "ModelStructure")
        for name, unknowns in self._structure("3.0"):
            for reference, attributes in unknowns:
                ET.SubElement(structure, name, {"valueReference": str(reference), **attributes})
        return markup.text(root)

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
            providesDirectionalDerivative="true",
        )
        files = ET.SubElement(simulation, "SourceFiles")
        for name in sources:
            ET.SubElement(files, "File", name=name)
        self._common(root)
        variables = ET.SubElement(root, "ModelVariables")
        for reference, scalar in enumerate(self.where.order, start=1):
            element = ET.SubElement(variables, "ScalarVariable", self._identity(scalar, reference))
            if scalar.kind == "input":
                element.attrib.pop("initial", None)
            real = ET.SubElement(element, "Real", _value(scalar))
            if scalar.kind == "rate":
                real.set("derivative", str(self._state(reference)))
        structure = ET.SubElement(root, "ModelStructure")
        # Without time, the position in the list is the value reference.
        groups = {
            "Output": "Outputs",
            "ContinuousStateDerivative": "Derivatives",
            "InitialUnknown": "InitialUnknowns",
        }
        for name, unknowns in self._structure("2.0"):
            if unknowns:
                group = ET.SubElement(structure, groups[name])
                for reference, attributes in unknowns:
                    ET.SubElement(group, "Unknown", {"index": str(reference), **attributes})
        return markup.text(root)

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
        _units(root, self.model, self.system)
        categories = ET.SubElement(root, "LogCategories")
        ET.SubElement(categories, "Category", name="logStatusError", description="Why a call failed")
        ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="100", stepSize=repr(self.step))

    def _state(self, rate: int) -> int:
        """Return the value reference of the state whose derivative has this one."""
        return rate - self.where.first("rate") + self.where.first("state")

    def _structure(self, version: str) -> list[tuple[str, list[tuple[int, dict[str, str]]]]]:
        """Return what the model computes: the kind of unknown, and the value reference of each of them."""
        numbered = list(enumerate(self.where.order, start=1))
        outputs = [(i, s) for i, s in numbered if s.variable.causality == "output"]
        rates = [(i, s) for i, s in numbered if s.kind == "rate"]
        unknown = [
            (i, s)
            for i, s in numbered
            if settable_until(s) == 0
            and (s.kind in ("calculated", "state", "rate") or s.variable.causality == "output")
        ]
        knowns = {s.symbol for s in self.where.order if s.kind in _KNOWNS[version]}
        starts = {s.symbol for s in self.where.order if settable_until(s)}
        if version == "3.0":  # the other one has no variable for time
            knowns.add(TIME)
            starts.add(TIME)
        running, initial = self.sensitivity.running, self.sensitivity.initial
        return [
            ("Output", [(i, self._dependence(running, s, knowns)) for i, s in outputs]),
            ("ContinuousStateDerivative", [(i, self._dependence(running, s, knowns)) for i, s in rates]),
            ("InitialUnknown", [(i, self._dependence(initial, s, starts)) for i, s in unknown]),
        ]

    def _dependence(
        self, on: Mapping[sp.Symbol, Dependence], scalar: Scalar, among: set[sp.Symbol]
    ) -> dict[str, str]:
        found = on.get(scalar.symbol, {})
        kinds = {self.where.reference[s]: kind for s, kind in found.items() if s in among}
        if on is self.sensitivity.initial:  # other factors have no names of their own there
            kinds = {i: kind if kind == "constant" else "dependent" for i, kind in kinds.items()}
        ordered = sorted(kinds.items())
        return {
            "dependencies": " ".join(str(i) for i, _ in ordered),
            "dependenciesKind": " ".join(kind for _, kind in ordered),
        }

    def _identity(self, scalar: Scalar, reference: int) -> dict[str, str]:
        v = scalar.variable
        kinds = {"parameter": "parameter", "calculated": "calculatedParameter"}
        attributes = {
            "name": scalar.symbol.name,
            "valueReference": str(reference),
            "causality": kinds.get(scalar.kind, v.causality),
            "variability": self.sensitivity.variability(scalar),
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


def _units(root: ET.Element, model: FlatModel, system: System) -> None:
    users = {s.variable.unit: s.variable for s in reversed(system.scalars) if s.variable.unit}
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({"s", *users}):
        try:
            exponents, factor, offset = base(unit)
        except (KeyError, ValueError):
            user = users[unit]
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


def build_description(identifier: str, sources: Sequence[str]) -> str:
    """XML text that tells an importer of FMI 3.0 how to compile the C files ``sources``."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    group = ET.SubElement(configuration, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=off")
    for name in sources:
        ET.SubElement(group, "SourceFile", name=name)
    return markup.text(root)
