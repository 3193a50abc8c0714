"""A co-simulated run with all of it in memory, for tests that look at its channels."""

import numpy as np

from lpfcosim.cosim import co_simulation, read_interfaces
from lpfcosim.models import model_of, stimuli
from tests.oracles import fmpy_loop


def simulate(run, fmus):
    """Channels of a run by name, each of shape (n_samples,), SI."""
    parts = list(co_simulation.blocks(run, read_interfaces(run, fmus)))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def simulate_by_fmpy(run, fmus, steps=None):
    """Channels of a run as `simulate` has them, by the loop of FMPy; `steps` by model, in one of the loop."""
    model, signals = model_of(run), stimuli.stimuli(run)
    values = model.parameters(run)
    places = [
        fmpy_loop.Place(
            fmus[i.model],
            dict(zip(i.inputs, i.component.inputs.values(), strict=True)),
            {i.name(output): f"{i.model}.{output}" for output in i.component.outputs},
            i.parameters(values[i.model]),
            (steps or {}).get(i.model, 1),
        )
        for i in read_interfaces(run, fmus)
    ]
    drawn = {name: signals[name] for name in model.stimuli(run)}
    return fmpy_loop.simulate(places, drawn, model.record, run.h)
