"""``modelDescription.xml`` for FMI 2.0 and 3.0, and ``buildDescription.xml``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import sympy as sp

from lpfcosim.modelica import markup
from lpfcosim.modelica.expressions import TIME
from lpfcosim.modelica.flat import FlatModel, UnsupportedError
from lpfcosim.modelica.sensitivity import KINDS, Dependence, Sensitivity
from lpfcosim.modelica.system import System
from lpfcosim.modelica.unit import base
from lpfcosim.modelica.variables import Declared, references

# Kinds of knowns after initialization: those of FMI 2.0, and what FMI 3.0 counts as well.
_KNOWNS = {"2.0": ("input", "state"), "3.0": ("input", "state", "discrete", "parameter")}


@dataclass(frozen=True)
class Description:
    """What both versions of the model description say.

    Attributes
    ----------
    model, system, sensitivity : FlatModel, System, Sensitivity
        The model, sorted, with what follows from what.
    variables : tuple of Declared
        What is declared, in the version of FMI that is asked for.
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
    variables: tuple[Declared, ...]
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
        self, on: Mapping[sp.Symbol, Dependence], declared: Declared, among: set[sp.Symbol]
    ) -> dict[str, str]:
        """Return what any element depends on, by the least simple factor of all."""
        reference = {TIME: 0, **references(self.variables)}
        kinds: dict[int, str] = {}
        for element in declared.elements:
            for symbol, kind in on.get(element.symbol, {}).items():
                if symbol in among:
                    i = reference[symbol]
                    kinds[i] = max(kind, kinds.get(i, kind), key=KINDS.index)
        if on is self.sensitivity.initial:  # other factors have no names of their own there
            kinds = {i: kind if kind == "constant" else "dependent" for i, kind in kinds.items()}
        ordered = sorted(kinds.items())
        return {
            "dependencies": " ".join(str(i) for i, _ in ordered),
            "dependenciesKind": " ".join(kind for _, kind in ordered),
        }

    def _identity(self, declared: Declared) -> dict[str, str]:
        v = declared.elements[0].variable
        kinds = {"parameter": "parameter", "calculated": "calculatedParameter"}
        found = {self.sensitivity.variability(s) for s in declared.elements}
        if declared.kind == "parameter" and len(found) > 1:  # what some elements are not, all are not
            found = {"fixed"}
        attributes = {
            "name": declared.name,
            "valueReference": str(declared.reference),
            "causality": kinds.get(declared.kind, v.causality),
            "variability": max(found),  # an array that follows from others is tunable if an element is
        }
        if v.description:
            attributes["description"] = v.description
        if declared.kind != "input":  # an input is "exact" by definition
            attributes["initial"] = "exact" if declared.settable else "calculated"
        return attributes


def _value(declared: Declared) -> dict[str, str]:
    v = declared.elements[0].variable
    attributes = {name: value for name, value in (("quantity", v.quantity), ("unit", v.unit)) if value}
    # What is said once has to hold for all elements.
    for name, of, choose in (
        ("min", [s.minimum for s in declared.elements], min),
        ("max", [s.maximum for s in declared.elements], max),
        ("nominal", [s.nominal for s in declared.elements], min),
    ):
        told = [x for x in of if x is not None]
        if len(told) == len(of):
            attributes[name] = repr(choose(told))
    if declared.settable:
        attributes["start"] = declared.start
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
