"""What drives a run: injections, set points and noise."""

import numpy as np
from numpy.typing import NDArray

from lpfcosim.models.spacecraft_model import model_of
from lpfcosim.signals import Noise, injected
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]


def injections(run: Run, start: int = 0, stop: int | None = None) -> dict[str, Array]:
    """Return injected signals and set points of a run, as `signals.injected`."""
    spacecraft = model_of(run)
    return injected(run, spacecraft.targets, spacecraft.attitude_rates(run), start, stop)


def noise_source(run: Run) -> Noise:
    """Return the noise of a run at its beginning."""
    return Noise(run, model_of(run).sources(run))


def noise(run: Run) -> dict[str, Array]:
    """Draw the noise of a whole run, each signal of shape (n_samples,)."""
    return noise_source(run).take(run.n_samples)


def stimuli(run: Run) -> dict[str, Array]:
    """Return all signals from outside of a whole run, each of shape (n_samples,)."""
    return injections(run) | noise(run)
