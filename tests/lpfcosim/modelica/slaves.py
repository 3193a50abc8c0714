"""FMUs of both versions through plain FMPy, and their descriptions through plain lxml."""

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

    ``variables`` are attributes by name; ``structure`` has, by kind of unknown and its name, the kinds of the
    factors by the name of the known, or None where it is left open.
    """

    identifier: str
    token: str
    version: str
    variables: dict = field(default_factory=dict)
    structure: dict = field(default_factory=dict)

    def names(self, **attributes):
        return [
            name
            for name, own in self.variables.items()
            if all(own.get(key) in value for key, value in attributes.items())
        ]

    def vr(self, names):
        return [int(self.variables[name]["valueReference"]) for name in names]


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
    for element in root.find("ModelVariables"):
        found.variables[element.get("name")] = {
            **element.attrib,
            **(element[0].attrib if len(element) else {}),
        }
    ordered = list(found.variables)
    by_reference = {int(v["valueReference"]): name for name, v in found.variables.items()}
    groups = {
        "Outputs": "Output",
        "Derivatives": "ContinuousStateDerivative",
        "InitialUnknowns": "InitialUnknown",
    }
    for element in root.find("ModelStructure").iter(etree.Element):
        if newer and element.get("valueReference"):
            kind, name = element.tag, by_reference[int(element.get("valueReference"))]
            known = [by_reference[int(i)] for i in element.get("dependencies", "").split()]
        elif element.get("index"):
            kind, name = groups[element.getparent().tag], ordered[int(element.get("index")) - 1]
            known = [ordered[int(i) - 1] for i in element.get("dependencies", "").split()]
        else:
            continue
        kinds = element.get("dependenciesKind", "").split()
        stated = None if element.get("dependencies") is None else dict(zip(known, kinds, strict=True))
        found.structure.setdefault(kind, {})[name] = stated
    return found


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
        made.set = lambda names, to: (made.setFloat64 if newer else made.setReal)(own.vr(names), list(to))
        made.get = lambda names: (made.getFloat64 if newer else made.getReal)(own.vr(names))
        made.set(list(values), list(values.values()))
        try:
            yield made
        finally:
            (made.fmi3FreeInstance if newer else made.fmi2FreeInstance)(made.component)
            made.freeLibrary()
