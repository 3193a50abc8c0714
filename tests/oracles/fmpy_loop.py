"""A loop of FMUs stepped by FMPy, value by value in Python: the compiled loop must give the same bits."""

import tempfile
from contextlib import ExitStack

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave


class Slave:
    """One FMU of the loop, its real variables by name."""

    def __init__(self, stack, archive, parameters):
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        fmpy.extract(str(archive), folder)
        description = fmpy.read_model_description(str(archive))
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.second = description.fmiVersion == "2.0"
        self.fmu = (FMU2Slave if self.second else FMU3Slave)(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="oracle",
        )
        self.fmu.instantiate()
        stack.callback(self.fmu.freeInstance)
        self.set(parameters)
        if self.second:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()

    def set(self, values):
        """Set variables."""
        set_values = self.fmu.setReal if self.second else self.fmu.setFloat64
        set_values([self.references[name] for name in values], list(values.values()))

    def get(self, names):
        """Return the values of variables."""
        get_values = self.fmu.getReal if self.second else self.fmu.getFloat64
        return get_values([self.references[name] for name in names])


def simulate(components, archives, parameters, signals, record, h, steps=None):
    """Signals of the loop by name, each of shape (N,).

    Parameters
    ----------
    components : sequence
        Places in the loop in the order of the steps, with `model`, `inputs` (source by name) and `outputs`.
    archives, parameters : mapping
        FMU, and values by name, by model.
    signals : mapping of str to ndarray, each of shape (N,)
        From outside.
    record : mapping of str to str
        Source of what is recorded.
    h : float
        Step of the loop [s].
    steps : mapping of str to int, optional
        By model, in how many steps the FMU covers one of the loop.
    """
    n = len(next(iter(signals.values())))
    bus = {f"{c.model}.{name}": 0.0 for c in components for name in c.outputs}
    recorded = {name: np.empty(n) for name in record}
    with ExitStack() as stack:
        loop = [(c, Slave(stack, archives[c.model], parameters[c.model])) for c in components]
        for i in range(-1, n):  # -1: initialization
            bus.update((name, float(x[max(i, 0)])) for name, x in signals.items())
            for component, slave in loop:
                slave.set({name: bus[source] for name, source in component.inputs.items()})
                for k in range(parts := (steps or {}).get(component.model, 1)) if i >= 0 else ():
                    slave.fmu.doStep(i * h + k * (h / parts), h / parts)
                outputs = zip(component.outputs, slave.get(component.outputs), strict=True)
                bus.update((f"{component.model}.{name}", x) for name, x in outputs)
            if i < 0:
                for _, slave in loop:
                    slave.fmu.exitInitializationMode()
            else:
                for name, source in record.items():
                    recorded[name][i] = bus[source]
    return recorded
