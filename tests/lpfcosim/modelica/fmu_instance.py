"""FMUs of both versions through plain FMPy, their variables by name; an array is set and read whole."""

from contextlib import contextmanager
from math import prod
from tempfile import TemporaryDirectory

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave


class Description:
    """Description of an archive, as FMPy reads it.

    ``structure`` has, by kind of unknown and its name, the kinds of the factors by the name of the known, or
    None where it is left open.
    """

    def __init__(self, archive):
        self.model = fmpy.read_model_description(str(archive))
        self.version = self.model.fmiVersion
        self.variables = {v.name: v for v in self.model.modelVariables}
        self.structure = {
            kind: {unknown.variable.name: self._kinds(unknown) for unknown in unknowns}
            for kind, unknowns in (
                ("Output", self.model.outputs),
                ("ContinuousStateDerivative", self.model.derivatives),
                ("InitialUnknown", self.model.initialUnknowns),
            )
        }

    @staticmethod
    def _kinds(unknown):
        if unknown.dependencies is None:
            return None
        names = [variable.name for variable in unknown.dependencies]
        return dict(zip(names, unknown.dependenciesKind, strict=True))

    def names(self, **attributes):
        """Names of the variables whose attributes are among the given values."""
        return [
            name
            for name, variable in self.variables.items()
            if all(getattr(variable, key) in values for key, values in attributes.items())
        ]

    def vr(self, names):
        return [self.variables[name].valueReference for name in names]

    def sizes(self, names):
        return [prod(self.variables[name].shape or ()) for name in names]


@contextmanager
def fmu_instance(archive, **values):
    """Yield an instance in initialization mode with ``values`` set; get and set take variables by name."""
    description = Description(archive)
    fmi3 = description.version == "3.0"
    with TemporaryDirectory() as folder:
        instance = (FMU3Slave if fmi3 else FMU2Slave)(
            instanceName="one",
            guid=description.model.guid,
            modelIdentifier=description.model.coSimulation.modelIdentifier,
            unzipDirectory=fmpy.extract(str(archive), folder),
        )

        def read(names):
            references = description.vr(names)
            if fmi3:
                return instance.getFloat64(references, sum(description.sizes(names)))
            return instance.getReal(references)

        def write(names, numbers):
            sizes = description.sizes(names)
            elements = [np.broadcast_to(x, n) for x, n in zip(numbers, sizes, strict=True)]
            flat = np.concatenate([*elements, np.empty(0)]).tolist()
            (instance.setFloat64 if fmi3 else instance.setReal)(description.vr(names), flat)

        instance.get, instance.set = read, write
        if fmi3:
            instance.instantiate(logMessage=lambda *_: None)
        else:
            instance.instantiate()
            instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        instance.set(list(values), list(values.values()))
        try:
            yield instance
        finally:
            (instance.fmi3FreeInstance if fmi3 else instance.fmi2FreeInstance)(instance.component)
            instance.freeLibrary()
