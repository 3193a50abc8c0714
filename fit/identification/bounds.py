"""Bounds at which a search holds parameters, tested against the data.

At the minimum within bounds the gradient of chi^2 does not vanish for a parameter at its bound. The joint
model fitted without the bounds says where the data put it; in units of the covariance there, the distance is
the Wald statistic of the bounds, which for a model that is linear about the estimate equals the score
statistic (that of the Lagrange multipliers).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import IRLSResult, Prior, parameter_values
from fit.warnings import FitWarning

Array = NDArray[np.float64]

FALSE_ALARM = 1e-3  # probability with which bounds that hold are contradicted by noise
MOVES = 0.3  # sigma, by which an estimate moves without the bounds if it rests on them


class Bound(NamedTuple):
    """A bound of a parameter, SI."""

    value: float
    is_lower: bool


@dataclass(frozen=True)
class Limit:
    """A bound at which a parameter is held.

    Attributes
    ----------
    name : str
        The parameter.
    bound : Bound
        The bound.
    free, sigma : float
        Where the data put the parameter without bounds, and the standard deviation of that.
    probability : float
        With which noise alone puts all parameters that are held as far beyond their bounds, 1e-300 at least.
    moves : dict of str to float
        Other parameters whose estimates rest on the bounds, and by how many sigma they move without.
    """

    name: str
    bound: Bound
    free: float
    sigma: float
    probability: float
    moves: dict[str, float]

    @property
    def pull(self) -> float:
        """By how many sigma the data put the parameter beyond its bound; negative within it."""
        beyond = self.bound.value - self.free if self.bound.is_lower else self.free - self.bound.value
        return beyond / self.sigma

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the bounds."""
        return self.probability < FALSE_ALARM

    @property
    def record(self) -> dict[str, object]:
        """What the provenance has of it."""
        return {
            "value": self.bound.value,
            "bound": "min" if self.bound.is_lower else "max",
            "unbounded": self.free,
            "sigma": self.sigma,
            "probability": self.probability,
        }

    def __str__(self) -> str:
        which = "lower" if self.bound.is_lower else "upper"
        where = f"{self.pull:.2g} sigma beyond" if self.pull > 0 else "within it"
        return (
            f"{self.name} is held at its {which} bound {self.bound.value:.6g}, the data put it at "
            f"{self.free:.6g} ± {self.sigma:.2g}, {where}"
        )


def tested(outcome: IRLSResult, weak: Mapping[int, Prior], at: Mapping[int, Bound]) -> list[Limit]:
    """Test the bounds at which parameters are held.

    Parameters
    ----------
    outcome : IRLSResult
        With the parameters at their bounds.
    weak : mapping of int to Prior
        What is known beside data and bounds, by place of the parameter.
    at : mapping of int to Bound
        Which parameters are at a bound, and the bound.
    """
    theta = outcome.solution.theta
    assert outcome.model is not None
    assert outcome.result is not None
    departures = {
        i: Prior(0.0, float(scale))
        for width, (log_width, _) in zip(outcome.departing, outcome.log_widths, strict=True)
        for i, scale in zip(width.members, np.exp(log_width) * width.units, strict=True)
    }
    params = outcome.result.params.copy()
    for i, p in enumerate(params.values()):
        p.user_data = {**weak, **departures}.get(i)
    unbounded = outcome.model.fit(params).params
    free, covariances = parameter_values(unbounded), outcome.model.covariance(unbounded)
    sigma = np.sqrt(np.diag(covariances))
    moves = (free - theta) / sigma
    held = list(at)
    beyond, correlations = moves[held], (covariances / np.outer(sigma, sigma))[np.ix_(held, held)]
    # parameters that the data hardly tell apart make the matrix singular
    statistic = float(beyond @ np.linalg.lstsq(correlations, beyond, rcond=1e-12)[0])
    probability = max(float(scipy.special.chdtrc(len(at), statistic)), 1e-300)
    names = [p.name for p in outcome.parameters[: outcome.shared]]
    others = {name: float(moves[k]) for k, name in enumerate(names) if k not in at and abs(moves[k]) > MOVES}
    return [
        Limit(names[k], bound, float(free[k]), float(sigma[k]), probability, others)
        for k, bound in at.items()
    ]


def warnings(limits: Sequence[Limit], reported: Collection[str]) -> list[FitWarning]:
    """Report the bounds at which parameters are held, and whether the data contradict them.

    Parameters
    ----------
    limits : sequence of Limit
        The bounds.
    reported : collection of str
        The parameters that are estimated.
    """
    if not limits:
        return []
    contradicted = limits[0].contradicted
    which = "the bound" if len(limits) == 1 else "the bounds"
    so = f"the data contradict {which}" if contradicted else "noise explains it"
    message = f"{'; '.join(map(str, limits))}; probability {limits[0].probability:.2g}: {so}"
    moves = {name: move for name, move in limits[0].moves.items() if name in reported}
    if moves:
        moved = ", ".join(f"{name} by {move:+.2g} sigma" for name, move in moves.items())
        message += f"; without {which} these would move: {moved}"
    names = (*(limit.name for limit in limits), *moves)
    return [FitWarning("bound_contradicted" if contradicted else "at_bound", names, message)]
