"""Noise that is louder in one part of a run than in another.

The weights know one PSD for the whole run. An estimate from them is unbiased still, but its sigma is not: a
signal that falls into a loud part is known less well than one in a quiet part. The residual of an experiment
by itself tells, for low and for high frequencies, how its power is spread over the run. Where chance does not
spread it so, the covariance of the scores is that of noise of this power.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError
from fit.fitting import IRLSResult, unsteady
from fit.spectra import windowing
from fit.warnings import FitWarning
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]

BANDS = ((0.0, 3e-3), (3e-3, 1.0))  # Hz
PARTS = 4
FEW = 16.0  # degrees of freedom in a part, below which nothing is told
CHANCE = 1e-6  # of one band of one run, below which it is not steady


def measure(experiment: Experiment, outcome: IRLSResult, at: int = 0) -> unsteady.Steps:
    """Return the bands in which the noise of a run is not steady, and how it is spread there.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    outcome : IRLSResult
        Of a fit to it.
    at : int
        Number of the experiment in that fit.
    """
    block = outcome.blocks[at]
    return of_block(block, outcome.solution.theta, experiment.sysid.spectra(block.tau).f)


def of_block(block: whitened_run.WhitenedRun, theta: Array, f: Array) -> unsteady.Steps:
    """Return what `measure` does, of a whitened run with bins f [Hz], shape (B,), at theta, shape (P,)."""
    if block.window is None:
        return ()
    n = block.window.size
    residual = block.columns @ block.coefficients(theta) * np.sqrt(block.weights.fit)
    bins = np.stack([(f > low) & (f <= high) for low, high in BANDS], axis=1)
    starts = np.searchsorted(unsteady.parts(block.window, PARTS), np.arange(PARTS))
    powers = np.add.reduceat(
        windowing.inverse_transform(residual[:, None] * bins, block.first, n) ** 2, starts
    )
    weight, found = np.add.reduceat(block.window**2, starts), []
    for (low, high), power, count in zip(BANDS, powers.T, np.count_nonzero(bins, axis=0), strict=True):
        relative = power / weight / (power.sum() / weight.sum())
        freedom = 2 * count * weight / weight.sum()
        if np.min(freedom) < FEW or not np.all(relative > 0):
            continue
        # likelihood ratio of as many variances as there are parts against one
        if scipy.special.chdtrc(PARTS - 1, -float(freedom @ np.log(relative))) < CHANCE:
            found.append((low, high, relative))
    return tuple(found)


def judged(
    experiments: Sequence[Experiment], alone: Mapping[str, IRLSResult | FitError]
) -> dict[str, tuple[FitWarning, Experiment]]:
    """Return by name the experiments whose noise is not steady, what to say of it, and how to fit them."""
    found = {}
    for e in experiments:
        own = alone[e.name]
        steps = measure(e, own) if isinstance(own, IRLSResult) else ()
        if steps:
            found[e.name] = told(e.name, steps), replace(e, unsteady=steps)
    return found


def told(name: str, steps: unsteady.Steps) -> FitWarning:
    """Return what to say of an experiment of that name."""
    least, most = (pick(float(pick(power)) for _, _, power in steps) for pick in (min, max))
    message = (
        f"{name}: the power of its noise changes within the run, from {least:.2g} to {most:.2g} "
        "times its mean in quarters of it; the sigmas allow for that"
    )
    return FitWarning("nonstationary_noise", (), message)
