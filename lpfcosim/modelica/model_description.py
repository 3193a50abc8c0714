"""``modelDescription.xml`` for FMI 2.0 and 3.0, and ``buildDescription.xml``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import sympy as sp

from fit.units import UnknownUnitError, in_base_units
from lpfcosim.modelica.evaluator import TIME
from lpfcosim.modelica.flat_model import FlatModel, UnsupportedError
from lpfcosim.modelica.sensitivity import KINDS, Dependence, Sensitivity
from lpfcosim.modelica.sorted_model import SortedModel
from lpfcosim.modelica.variables import FmiVariable, value_references
from lpfcosim.modelica.xml_text import serialize_xml

# Kinds of knowns after initialization: those of FMI 2.0, and what FMI 3.0 counts as well.
_KNOWNS = {"2.0": ("input", "state"), "3.0": ("input", "state", "discrete", "parameter")}


@dataclass(frozen=True)
class ModelDescription:
    """Content that both versions of the model description share.

    Attributes
    ----------
    flat, model, sensitivity : FlatModel, SortedModel, Sensitivity
        The flat model, the sorted model and its dependencies.
    variables : tuple of FmiVariable
        Variables as the chosen version of FMI declares them.
    token : str
        GUID (FMI 2.0) or instantiation token (FMI 3.0).
    step : float
        Internal step [s].
    tool : str
        Name of the generator.
    """

    flat: FlatModel
    model: SortedModel
    sensitivity: Sensitivity
    variables: tuple[FmiVariable, ...]
    token: str
    step: float
    tool: str

    def fmi3(self) -> str:
        """XML text for FMI 3.0 co-simulation."""
        root = self._root("3.0", "instantiationToken")
        ET.SubElement(
            root,
            "CoSimulation",
            modelIdentifier=self.model.name,
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
        states = self._states()
        for declared in self.variables:
            element = ET.SubElement(variables, "Float64", self._identity(declared))
            element.attrib.update(_value(declared))
            if declared.kind == "rate":
                element.set("derivative", str(states[declared.reference]))
            for extent in declared.dims:
                ET.SubElement(element, "Dimension", start=str(extent))
        structure = ET.SubElement(root, "ModelStructure")
        for name, unknowns in self._structure("3.0"):
            for reference, attributes in unknowns:
                ET.SubElement(structure, name, {"valueReference": str(reference), **attributes})
        return serialize_xml(root)

    def fmi2(self, sources: Sequence[str]) -> str:
        """XML text for FMI 2.0 co-simulation, built from the C files ``sources``."""
        root = self._root("2.0", "guid")
        simulation = ET.SubElement(
            root,
            "CoSimulation",
            modelIdentifier=self.model.name,
            canHandleVariableCommunicationStepSize="false",
            canGetAndSetFMUstate="true",
            canSerializeFMUstate="true",
        )
        files = ET.SubElement(simulation, "SourceFiles")
        for name in sources:
            ET.SubElement(files, "File", name=name)
        self._common(root)
        variables = ET.SubElement(root, "ModelVariables")
        states = self._states()
        for declared in self.variables:
            element = ET.SubElement(variables, "ScalarVariable", self._identity(declared))
            if declared.kind == "input":
                element.attrib.pop("initial", None)
            real = ET.SubElement(element, "Real", _value(declared))
            if declared.kind == "rate":
                real.set("derivative", str(states[declared.reference]))
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
        return serialize_xml(root)

    def _root(self, version: str, identity: str) -> ET.Element:
        root = ET.Element("fmiModelDescription", fmiVersion=version, modelName=self.flat.name)
        root.set(identity, self.token)
        root.attrib.update(
            description=self.flat.description,
            version="1",
            license="BSD-3-Clause",
            generationTool=self.tool,
            variableNamingConvention="structured",
        )
        return root

    def _common(self, root: ET.Element) -> None:
        _units(root, self.flat, self.model)
        categories = ET.SubElement(root, "LogCategories")
        ET.SubElement(categories, "Category", name="logStatusError", description="Why a call failed")
        ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="100", stepSize=repr(self.step))

    def _states(self) -> dict[int, int]:
        """Return the value reference of the state by that of its derivative."""
        states, rates = ([d for d in self.variables if d.kind == kind] for kind in ("state", "rate"))
        return {rate.reference: state.reference for rate, state in zip(rates, states, strict=True)}

    def _structure(self, version: str) -> list[tuple[str, list[tuple[int, dict[str, str]]]]]:
        """Return what the model computes: the kind of unknown, and the value reference of each of them."""
        outputs = [d for d in self.variables if d.causality == "output"]
        rates = [d for d in self.variables if d.kind == "rate"]
        unknown = [
            d
            for d in self.variables
            if d.settable == 0 and (d.kind in ("calculated", "state", "rate") or d.causality == "output")
        ]
        knowns = {s.symbol for d in self.variables if d.kind in _KNOWNS[version] for s in d.elements}
        starts = {s.symbol for d in self.variables if d.settable for s in d.elements}
        if version == "3.0":  # the other one has no variable for time
            knowns.add(TIME)
            starts.add(TIME)
        running, initial = self.sensitivity.running, self.sensitivity.initial
        return [
            ("Output", [(d.reference, self._dependence(running, d, knowns)) for d in outputs]),
            (
                "ContinuousStateDerivative",
                [(d.reference, self._dependence(running, d, knowns)) for d in rates],
            ),
            ("InitialUnknown", [(d.reference, self._dependence(initial, d, starts)) for d in unknown]),
        ]

    def _dependence(
        self, dependences: Mapping[sp.Symbol, Dependence], declared: FmiVariable, knowns: set[sp.Symbol]
    ) -> dict[str, str]:
        """Return the dependencies of all elements, each with its least simple kind."""
        reference = {TIME: 0, **value_references(self.variables)}
        kinds: dict[int, str] = {}
        for element in declared.elements:
            for symbol, kind in dependences.get(element.symbol, {}).items():
                if symbol in knowns:
                    i = reference[symbol]
                    kinds[i] = max(kind, kinds.get(i, kind), key=KINDS.index)
        if dependences is self.sensitivity.initial:  # other factors have no names of their own there
            kinds = {i: kind if kind == "constant" else "dependent" for i, kind in kinds.items()}
        ordered = sorted(kinds.items())
        return {
            "dependencies": " ".join(str(i) for i, _ in ordered),
            "dependenciesKind": " ".join(kind for _, kind in ordered),
        }

    def _identity(self, declared: FmiVariable) -> dict[str, str]:
        v = declared.elements[0].variable
        kinds = {"parameter": "parameter", "calculated": "calculatedParameter"}
        variabilities = {self.sensitivity.variability(s) for s in declared.elements}
        if declared.kind == "parameter" and len(variabilities) > 1:  # all elements are tunable, or none
            variabilities = {"fixed"}
        attributes = {
            "name": declared.name,
            "valueReference": str(declared.reference),
            "causality": kinds.get(declared.kind, v.causality),
            "variability": max(
                variabilities
            ),  # an array that follows from others is tunable if an element is
        }
        if v.description:
            attributes["description"] = v.description
        if declared.kind != "input":  # an input is "exact" by definition
            attributes["initial"] = "exact" if declared.settable else "calculated"
        return attributes


def _value(declared: FmiVariable) -> dict[str, str]:
    v = declared.elements[0].variable
    attributes = {name: value for name, value in (("quantity", v.quantity), ("unit", v.unit)) if value}
    # An attribute of an array has to hold for all elements.
    for name, limits, select in (
        ("min", [s.minimum for s in declared.elements], min),
        ("max", [s.maximum for s in declared.elements], max),
        ("nominal", [s.nominal for s in declared.elements], min),
    ):
        defined = [x for x in limits if x is not None]
        if len(defined) == len(limits):
            attributes[name] = repr(select(defined))
    if declared.settable:
        attributes["start"] = declared.start
    return attributes


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


def build_description(identifier: str, sources: Sequence[str]) -> str:
    """XML text that states for an importer of FMI 3.0 how to compile the C files ``sources``."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    group = ET.SubElement(configuration, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=off")
    for name in sources:
        ET.SubElement(group, "SourceFile", name=name)
    return serialize_xml(root)
