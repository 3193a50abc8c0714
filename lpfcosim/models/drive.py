"""What drives a run in its world: injections, set points and noise."""

import numpy as np
from numpy.typing import NDArray

from lpfcosim.models.world import world_of
from lpfcosim.signals import TARGETS, Noise, injected
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]


def names(run: Run) -> tuple[str, ...]:
    """Every signal that drives a run, injections first."""
    world = world_of(run)
    noises = (into for source in world.sources(run) for into, _ in source.shares)
    return tuple(dict.fromkeys((*TARGETS, *world.turns(run), *noises)))


def injections(run: Run, start: int = 0, stop: int | None = None) -> dict[str, Array]:
    """Injected signals and set points of a run, as `signals.injected`."""
    return injected(run, start, stop, world_of(run).turns(run))


def stream(run: Run) -> Noise:
    """Return the noise of a run at its beginning."""
    return Noise(run, world_of(run).sources(run))


def noise(run: Run) -> dict[str, Array]:
    """Draw the noise of a whole run, each signal of shape (n_samples,)."""
    return stream(run).take(run.n_samples)
