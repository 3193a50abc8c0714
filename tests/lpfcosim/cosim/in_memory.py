"""A co-simulated run with all of it in memory, for tests that look at its channels."""

import numpy as np

from lpfcosim.cosim import co_simulation, read_interfaces
from lpfcosim.models import model_of, stimuli
from tests.oracles import fmpy_loop


def simulate(run, fmus):
    """Channels of a run by name, each of shape (n_samples,), SI."""
    parts = list(co_simulation.blocks(run, read_interfaces(run, fmus)))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def simulate_by_fmpy(run, fmus):
    """Channels of a run as `simulate` has them, by the loop of FMPy."""
    model = model_of(run)
    signals = stimuli.stimuli(run)
    drawn = {name: signals[name] for name in model.stimuli(run)}
    components, parameters = model.components(run), model.parameters(run)
    return fmpy_loop.simulate(components, fmus, parameters, drawn, model.record, run.h)
