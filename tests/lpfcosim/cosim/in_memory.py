"""A co-simulated run with all of it in memory, for tests that look at its channels."""

import numpy as np

from lpfcosim.cosim import co_simulation, read_interfaces


def simulate(run, fmus, engine="compiled"):
    """Channels of a run by name, each of shape (n_samples,), SI."""
    parts = list(co_simulation.blocks(run, read_interfaces(run, fmus), engine))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
