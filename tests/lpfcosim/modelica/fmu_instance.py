"""FMUs of both versions through plain FMPy, and their descriptions through plain lxml."""

import itertools
import zipfile
from contextlib import contextmanager
from dataclasses import dataclass, field
from tempfile import TemporaryDirectory

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from lxml import etree


@dataclass
class ModelDescription:
    """Content of ``modelDescription.xml``, read independently of lpfcosim and FMPy.

    ``variables`` are attributes by name, the elements of an array by theirs; ``structure`` has, by kind of
    unknown and its name, the kinds of the factors by the name of the known, or None where it is left open.
    ``sizes`` counts elements by value reference.
    """

    identifier: str
    token: str
    version: str
    variables: dict = field(default_factory=dict)
    structure: dict = field(default_factory=dict)
    sizes: dict = field(default_factory=dict)

    def names(self, **attributes):
        return [
            name
            for name, variable in self.variables.items()
            if all(variable.get(key) in value for key, value in attributes.items())
        ]

    def spread(self, names):
        """References of whole variables, how many elements they have, and where among them these are."""
        offsets, places, total = {}, [], 0
        for name in names:
            reference = int(self.variables[name]["valueReference"])
            if reference not in offsets:
                offsets[reference] = total
                total += self.sizes[reference]
            places.append(offsets[reference] + self.variables[name]["element"])
        return list(offsets), total, places

    def vr(self, names):
        return self.spread(names)[0]

    def array(self, name):
        """The name of the whole variable."""
        return name.partition("[")[0] + (")" if name.startswith("der(") and name[-2:] == "])" else "")


def elements(name, extents):
    """The names of the elements of a variable, row by row, as Modelica counts."""
    if not extents:
        return [name]
    inner, end = (name[:-1], ")") if name.startswith("der(") else (name, "")
    return [
        f"{inner}[{','.join(map(str, place))}]{end}"
        for place in itertools.product(*(range(1, n + 1) for n in extents))
    ]


def read_description(archive):
    """Read the description of an archive."""
    with zipfile.ZipFile(archive) as archive_file:
        root = etree.fromstring(archive_file.read("modelDescription.xml"))
    fmi3 = root.get("fmiVersion").startswith("3")
    description = ModelDescription(
        root.find("CoSimulation").get("modelIdentifier"),
        root.get("instantiationToken" if fmi3 else "guid"),
        root.get("fmiVersion"),
    )
    by_reference = {}
    for element in root.find("ModelVariables"):
        attributes = {**element.attrib, **({} if fmi3 or not len(element) else element[0].attrib)}
        names = elements(element.get("name"), [int(d.get("start")) for d in element.iter("Dimension")])
        reference = int(attributes["valueReference"])
        by_reference[reference] = names
        description.sizes[reference] = len(names)
        starts = attributes["start"].split() if "start" in attributes else []
        for k, name in enumerate(names):
            description.variables[name] = {
                **attributes,
                "element": k,
                **({"start": starts[k]} if starts else {}),
            }
    ordered = list(description.variables)
    groups = {
        "Outputs": "Output",
        "Derivatives": "ContinuousStateDerivative",
        "InitialUnknowns": "InitialUnknown",
    }
    for element in root.find("ModelStructure").iter(etree.Element):
        if fmi3 and element.get("valueReference"):
            kind, names = element.tag, by_reference[int(element.get("valueReference"))]
            known = [by_reference[int(i)] for i in element.get("dependencies", "").split()]
        elif element.get("index"):
            kind, names = groups[element.getparent().tag], [ordered[int(element.get("index")) - 1]]
            known = [[ordered[int(i) - 1]] for i in element.get("dependencies", "").split()]
        else:
            continue
        kinds = element.get("dependenciesKind", "").split()
        stated = None
        if element.get("dependencies") is not None:
            stated = {name: kind for names_, kind in zip(known, kinds, strict=True) for name in names_}
        description.structure.setdefault(kind, {}).update(dict.fromkeys(names, stated))
    return description


def _by_element(instance, description, fmi3):
    """Add methods that access elements; arrays are read and set whole."""

    def read(references, total):
        return instance.getFloat64(references, total) if fmi3 else instance.getReal(references)

    def select(values, places):
        return [values[k] for k in places]

    def get(names):
        references, total, places = description.spread(names)
        return select(read(references, total), places)

    def put(names, to):
        references, total, places = description.spread(names)
        values = read(references, total) if total > len(names) else [0.0] * total
        for k, value in zip(places, to, strict=True):
            values[k] = value
        (instance.setFloat64 if fmi3 else instance.setReal)(references, values)

    instance.get, instance.set = get, put


@contextmanager
def fmu_instance(archive, **values):
    """Yield an instance in initialization mode with ``values`` set."""
    description = read_description(archive)
    fmi3 = description.version.startswith("3")
    with TemporaryDirectory() as folder:
        instance = (FMU3Slave if fmi3 else FMU2Slave)(
            instanceName="one", guid=description.token, modelIdentifier=description.identifier,
            unzipDirectory=fmpy.extract(str(archive), folder),
        )  # fmt: skip
        if fmi3:
            instance.instantiate(logMessage=lambda *_: None)
        else:
            instance.instantiate()
            instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        _by_element(instance, description, fmi3)
        instance.set(list(values), list(values.values()))
        try:
            yield instance
        finally:
            (instance.fmi3FreeInstance if fmi3 else instance.fmi2FreeInstance)(instance.component)
            instance.freeLibrary()
