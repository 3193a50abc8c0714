"""A loop of FMUs stepped by FMPy, value by value in Python: the compiled loop must give the same bits."""

import tempfile
from contextlib import ExitStack
from typing import NamedTuple

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave


class Place(NamedTuple):
    """An FMU in the loop: sources of its inputs, signals that its outputs are, values, steps in a sample."""

    archive: object
    inputs: dict
    outputs: dict
    parameters: dict
    steps: int = 1


class Slave:
    """One FMU in initialization mode, its real variables by name; what is not here are methods of FMPy's."""

    def __init__(self, stack, archive, parameters):
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        fmpy.extract(str(archive), folder)
        self.description = fmpy.read_model_description(str(archive))
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.second = self.description.fmiVersion == "2.0"
        self._fmu = (FMU2Slave if self.second else FMU3Slave)(
            guid=self.description.guid,
            unzipDirectory=folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="oracle",
        )
        self._fmu.instantiate()
        stack.callback(self._fmu.freeInstance)
        self.initialize(parameters)

    def __getattr__(self, name):
        return getattr(self._fmu, name)

    def initialize(self, parameters):
        """Set parameters and enter initialization mode, of a new instance or after a reset."""
        self.set(parameters)
        if self.second:
            self.setupExperiment(startTime=0.0)
        self.enterInitializationMode()

    def set(self, values):
        """Set variables."""
        set_values = self.setReal if self.second else self.setFloat64
        set_values([self.references[name] for name in values], list(values.values()))

    def get(self, names):
        """Return the values of variables."""
        get_values = self.getReal if self.second else self.getFloat64
        return get_values([self.references[name] for name in names])


def simulate(places, signals, record, h):
    """Signals of the loop by name, each of shape (N,).

    Parameters
    ----------
    places : sequence of Place
        In the order of the steps.
    signals : mapping of str to ndarray, each of shape (N,)
        From outside.
    record : mapping of str to str
        Source of what is recorded.
    h : float
        Step of the loop [s].
    """
    n = len(next(iter(signals.values())))
    bus = {signal: 0.0 for place in places for signal in place.outputs.values()}
    recorded = {name: np.empty(n) for name in record}
    with ExitStack() as stack:
        loop = [(place, Slave(stack, place.archive, place.parameters)) for place in places]
        for i in range(-1, n):  # -1: initialization
            bus.update((name, float(x[max(i, 0)])) for name, x in signals.items())
            for place, slave in loop:
                slave.set({variable: bus[source] for variable, source in place.inputs.items()})
                for k in range(place.steps) if i >= 0 else ():
                    slave.doStep(i * h + k * (h / place.steps), h / place.steps)
                bus.update(zip(place.outputs.values(), slave.get(place.outputs), strict=True))
            if i < 0:
                for _, slave in loop:
                    slave.exitInitializationMode()
            else:
                for name, source in record.items():
                    recorded[name][i] = bus[source]
    return recorded
