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
class Told:
    """What ``modelDescription.xml`` says, read by nothing of ours and nothing of FMPy's.

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
            for name, own in self.variables.items()
            if all(own.get(key) in value for key, value in attributes.items())
        ]

    def spread(self, names):
        """References of whole variables, how many elements they have, and where among them these are."""
        begin, places, total = {}, [], 0
        for name in names:
            reference = int(self.variables[name]["valueReference"])
            if reference not in begin:
                begin[reference] = total
                total += self.sizes[reference]
            places.append(begin[reference] + self.variables[name]["element"])
        return list(begin), total, places

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


def told(archive):
    """Read the description of an archive."""
    with zipfile.ZipFile(archive) as stored:
        root = etree.fromstring(stored.read("modelDescription.xml"))
    newer = root.get("fmiVersion").startswith("3")
    found = Told(
        root.find("CoSimulation").get("modelIdentifier"),
        root.get("instantiationToken" if newer else "guid"),
        root.get("fmiVersion"),
    )
    by_reference = {}
    for element in root.find("ModelVariables"):
        attributes = {**element.attrib, **({} if newer or not len(element) else element[0].attrib)}
        names = elements(element.get("name"), [int(d.get("start")) for d in element.iter("Dimension")])
        reference = int(attributes["valueReference"])
        by_reference[reference] = names
        found.sizes[reference] = len(names)
        starts = attributes["start"].split() if "start" in attributes else []
        for k, name in enumerate(names):
            found.variables[name] = {**attributes, "element": k, **({"start": starts[k]} if starts else {})}
    ordered = list(found.variables)
    groups = {
        "Outputs": "Output",
        "Derivatives": "ContinuousStateDerivative",
        "InitialUnknowns": "InitialUnknown",
    }
    for element in root.find("ModelStructure").iter(etree.Element):
        if newer and element.get("valueReference"):
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
            stated = {one: kind for all_, kind in zip(known, kinds, strict=True) for one in all_}
        found.structure.setdefault(kind, {}).update(dict.fromkeys(names, stated))
    return found


def _by_element(made, own, newer):
    """Let a slave be asked for elements; arrays are read and set whole."""

    def read(references, total):
        return made.getFloat64(references, total) if newer else made.getReal(references)

    def picked(values, places):
        return [values[k] for k in places]

    def get(names):
        references, total, places = own.spread(names)
        return picked(read(references, total), places)

    def put(names, to):
        references, total, places = own.spread(names)
        values = read(references, total) if total > len(names) else [0.0] * total
        for k, value in zip(places, to, strict=True):
            values[k] = value
        (made.setFloat64 if newer else made.setReal)(references, values)

    def pushed(function, seeded, seed, asked):
        references, total, places = own.spread(seeded)
        seeds = [0.0] * total
        for k, value in zip(places, seed, strict=True):
            seeds[k] = value
        others, size, found = own.spread(asked)
        return picked(function(references, seeds, others, size), found)

    made.get, made.set = get, put
    made.directional = lambda unknowns, knowns, seed: pushed(
        lambda by, seeds, of, size: made.getDirectionalDerivative(of, by, seeds, *([size] if newer else [])),
        knowns, seed, unknowns,
    )  # fmt: skip


@contextmanager
def slave(archive, **values):
    """Give a slave in initialization mode, ``values`` set."""
    own = told(archive)
    newer = own.version.startswith("3")
    with TemporaryDirectory() as folder:
        made = (FMU3Slave if newer else FMU2Slave)(
            instanceName="one", guid=own.token, modelIdentifier=own.identifier,
            unzipDirectory=fmpy.extract(str(archive), folder),
        )  # fmt: skip
        if newer:
            made.instantiate(logMessage=lambda *_: None)
        else:
            made.instantiate()
            made.setupExperiment(startTime=0.0)
        made.enterInitializationMode()
        _by_element(made, own, newer)
        made.set(list(values), list(values.values()))
        try:
            yield made
        finally:
            (made.fmi3FreeInstance if newer else made.fmi2FreeInstance)(made.component)
            made.freeLibrary()
