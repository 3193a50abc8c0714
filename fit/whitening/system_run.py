"""A run that is whitened in several equations, each by the PSD of its own residual."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from fit.whitening.likelihoods import Weights
from fit.whitening.whitened_run import WhitenedRun, qr_factor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SystemRun(WhitenedRun):
    """The blocks of a run as one run: the bins and coefficients of all equations in turn.

    The noise of the equations is independent. The columns without a parameter count as one.

    Attributes
    ----------
    parts : tuple of WhitenedRun
        The blocks; those of `blocks` have the parameter map of the run.
    """

    parts: tuple[WhitenedRun, ...] = field(kw_only=True)

    @property
    def blocks(self) -> tuple[WhitenedRun, ...]:
        """As that of `WhitenedRun`."""
        return tuple(replace(part, parameter_map=self.parameter_map) for part in self.parts)

    def coefficients(self, theta: Array) -> Array:
        """As that of `WhitenedRun`."""
        of_run = self.parameter_map @ theta
        c = [part.equation.coefficients(of_run, part.tau) for part in self.parts]
        return np.concatenate([c[0][:1], *(x[1:] for x in c)])

    def run_gradient(self, theta: Array, /) -> Array:
        """As that of `WhitenedRun`."""
        of_run = self.parameter_map @ theta
        slopes = [part.equation.gradient(of_run, part.tau) for part in self.parts]
        return np.concatenate([slopes[0][:1], *(x[1:] for x in slopes)])

    def without_data(self) -> "SystemRun":
        """As that of `WhitenedRun`."""
        return replace(super().without_data(), parts=tuple(part.without_data() for part in self.parts))

    @property
    def size(self) -> int:
        """As that of `WhitenedRun`."""
        return sum(part.size for part in self.parts)

    @cached_property
    def R(self) -> Array:
        """As that of `WhitenedRun`."""
        return qr_factor(np.concatenate([self._placed(part.R, i) for i, part in enumerate(self.parts)]))

    @cached_property
    def root_level(self) -> Array:
        """As that of `WhitenedRun`."""
        roots = [self._placed(part.root_level, i) for i, part in enumerate(self.parts)]
        return qr_factor(np.concatenate(roots))

    @cached_property
    def H(self) -> Array:
        """As that of `WhitenedRun`."""
        return self._summed(part.H for part in self.parts)

    @cached_property
    def M(self) -> Array:
        """As that of `WhitenedRun`."""
        return self._summed(part.M for part in self.parts)

    @cached_property
    def psd_scores(self) -> Array:
        """As that of `WhitenedRun`."""
        return self._summed(part.psd_scores for part in self.parts)

    @property
    def free_coefficients(self) -> Array:
        """As those of `WhitenedRun`."""
        return np.concatenate([np.ones(1), *(part.free_coefficients[1:] for part in self.parts)])

    @property
    def products(self) -> Array:
        """As that of `WhitenedRun`."""
        return self._summed(part.products for part in self.parts)

    @property
    def places(self) -> list[NDArray[np.intp]]:
        """The columns of each block among those of the run."""
        ends = accumulate((part.columns.shape[1] - 1 for part in self.parts), initial=1)
        return [np.array([0, *range(a, b)]) for a, b in pairwise(ends)]

    def _placed(self, rows: Array, i: int) -> Array:
        """Return rows over the columns of block i as rows over all columns."""
        placed = np.zeros((len(rows), self.columns.shape[1]))
        placed[:, self.places[i]] = rows
        return placed

    def _summed(self, matrices: Iterator[Array]) -> Array:
        K = self.columns.shape[1]
        total = np.zeros((K, K))
        for matrix, places in zip(matrices, self.places, strict=True):
            total[np.ix_(places, places)] += matrix
        return total


def system_run(parts: Sequence[WhitenedRun]) -> WhitenedRun:
    """Return the blocks of a run as one run, a single one as it is."""
    single_run = parts[0]
    if len(parts) == 1:
        return single_run
    n_columns = 1 + sum(part.columns.shape[1] - 1 for part in parts)
    weights = [part.weights for part in parts]
    even = [np.ones(len(w.fit)) if w.level is None else w.level for w in weights]
    run = SystemRun(
        single_run.tau,
        np.zeros((0, n_columns), np.complex128),
        Weights(
            np.concatenate([w.fit for w in weights]),
            np.concatenate([w.curvature for w in weights]),
            np.concatenate([w.score for w in weights]),
            None if all(w.level is None for w in weights) else np.concatenate(even),
            likelihood=weights[0].likelihood,
        ),
        single_run.window,
        single_run.parameter_map,
        names=single_run.equation.parameters,
        equation=single_run.equation,
        parts=tuple(parts),
    )
    columns = np.zeros((sum(len(part.columns) for part in parts), n_columns), np.complex128)
    ends = accumulate((len(part.columns) for part in parts), initial=0)
    for (a, b), part, places in zip(pairwise(ends), parts, run.places, strict=True):
        columns[a:b, places] = part.columns
    return replace(run, columns=columns)
