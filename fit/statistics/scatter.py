"""Gains and delays that scatter from run to run, as an explanation of runs that disagree.

Both test masses share a width, relative to the flight values. The likelihood is that of
`fit.fitting.random_effects`.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fit.fitting import estimate_widths, random_effects
from fit.parameters import joint_parameter
from fit.statistics.consistency_test import ConsistencyTest

Array = NDArray[np.float64]

# no false alarm but a choice of model: where nothing scatters sigmas get a little wider; missed, they are too
# small by a factor of up to five
P_SCATTER = 1e-3
SENSITIVITY = 1e-3  # inverse sigma, of itself and relative to the most sensitive run, from which a run counts
FEWEST = 3  # runs that must be sensitive to a deviation
CANDIDATES = tuple(
    candidate
    for gain, delay in pairwise(random_effects.RANDOM_EFFECTS)
    if {*gain.parameters} <= {*random_effects.DELAYS}
    for candidate in ((gain,), (delay,), (gain, delay))
)


def scattering_parameters(names: Sequence[str]) -> list[str]:
    """Return the gains and the delays that a fit gives random effects once either of them scatters.

    A width that the data leave open widens sigmas by no more than its posterior allows. Without it, a delay
    that one or two runs determine would have the sigma of noise alone.

    Parameters
    ----------
    names : sequence of str
        Parameters that have one value in all runs, and may scatter.
    """
    effects = [effect for effect in random_effects.RANDOM_EFFECTS if {*effect.parameters} <= {*names}]
    return [name for effect in effects for name in effect.parameters]


def estimate_scatter(test: ConsistencyTest, names: Sequence[str]) -> random_effects.WidthEstimate | None:
    """Return the widths of the most likely candidate; None if no run is sensitive to any.

    Parameters
    ----------
    test : ConsistencyTest
        The runs.
    names : sequence of str
        Parameters that have one value in all runs, and may scatter.
    """
    candidates = [c for c in CANDIDATES if all({*kind.parameters} <= {*names} for kind in c)]
    estimates = [e for kinds in candidates if (e := _estimate(test, kinds))]
    return max(estimates, key=lambda e: e.log_likelihood - len(e.widths), default=None)


def _estimate(
    test: ConsistencyTest, kinds: Sequence[random_effects.RandomEffect]
) -> random_effects.WidthEstimate | None:
    columns = []
    for kind in kinds:
        Z = test.residual_maker @ _deviations(test, kind)
        norms = np.linalg.norm(Z, axis=0)
        sensitive = norms > max(SENSITIVITY * norms.max(initial=0.0), SENSITIVITY)
        if np.unique(np.flatnonzero(sensitive) % len(test.runs)).size < FEWEST:
            return None
        columns.append(Z[:, sensitive])
    return estimate_widths(test.residual_maker @ test.residual, columns)


def _deviations(test: ConsistencyTest, kind: random_effects.RandomEffect) -> Array:
    """Return the effect of unit deviations of every run, test mass by test mass, in flight values."""
    columns = []
    for name in kind.parameters:
        for i, run in enumerate(test.runs):
            column = run.derivative(name) * joint_parameter(name).value
            if name in random_effects.DELAYS:  # the delay stays
                C = random_effects.DELAYS[name]
                column = column + run.derivative(C) * joint_parameter(C).value
            columns.append(test.column(i, column))
    return np.hstack(columns)
