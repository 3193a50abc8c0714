"""FMUs of FMI 2.0 through plain FMPy, their variables by name."""

from contextlib import contextmanager
from tempfile import TemporaryDirectory

import fmpy
from fmpy.fmi2 import FMU2Slave


class Description:
    """Description of an archive, as FMPy reads it.

    ``structure`` has, by kind of unknown and its name, the names of the knowns, or None where that is open.
    """

    def __init__(self, archive):
        self.model = fmpy.read_model_description(str(archive))
        self.variables = {v.name: v for v in self.model.modelVariables}
        self.structure = {
            kind: {
                u.variable.name: None if u.dependencies is None else {v.name for v in u.dependencies}
                for u in unknowns
            }
            for kind, unknowns in (
                ("Outputs", self.model.outputs),
                ("Derivatives", self.model.derivatives),
                ("InitialUnknowns", self.model.initialUnknowns),
            )
        }

    def names(self, **attributes):
        """Names of the variables whose attributes are among the given values."""
        return [
            name
            for name, variable in self.variables.items()
            if all(getattr(variable, key) in values for key, values in attributes.items())
        ]

    def vr(self, names):
        return [self.variables[name].valueReference for name in names]


@contextmanager
def fmu_instance(archive, **values):
    """Yield an instance in initialization mode with ``values`` set; get and set take variables by name."""
    description = Description(archive)
    with TemporaryDirectory() as folder:
        instance = FMU2Slave(
            instanceName="one",
            guid=description.model.guid,
            modelIdentifier=description.model.coSimulation.modelIdentifier,
            unzipDirectory=fmpy.extract(str(archive), folder),
        )
        instance.get = lambda names: instance.getReal(description.vr(names))
        instance.set = lambda names, numbers: instance.setReal(description.vr(names), [*map(float, numbers)])
        instance.instantiate()
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        instance.set(list(values), list(values.values()))
        try:
            yield instance
        finally:
            instance.fmi2FreeInstance(instance.component)
            instance.freeLibrary()
