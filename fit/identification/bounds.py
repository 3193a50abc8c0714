"""Bounds at which a search holds parameters, tested against the data.

At the minimum within bounds the gradient of chi^2 does not vanish for a parameter at its bound. The joint
model fitted without the bounds says where the data put it; in units of the covariance there, the distance is
the Wald statistic of the bounds, which for a model that is linear about the estimate equals the score
statistic (that of the Lagrange multipliers).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import Outcome, Prior, parameter_values
from fit.warnings import FitWarning

Array = NDArray[np.float64]

FALSE_ALARM = 1e-3  # probability with which bounds that hold are contradicted by noise
MOVES = 0.3  # sigma, by which an estimate moves without the bounds if it rests on them


@dataclass(frozen=True)
class Limit:
    """A bound at which a parameter is held.

    Attributes
    ----------
    name : str
        The parameter.
    lower : bool
        Whether it is its lower bound.
    value : float
        The bound, SI.
    free, sigma : float
        Where the data put the parameter without bounds, and the standard deviation of that.
    probability : float
        With which noise alone puts all parameters that are held as far beyond their bounds, 1e-300 at least.
    moved : tuple of str
        Other parameters whose estimates rest on the bounds, each as "name by so many sigma".
    resting : tuple of str
        Their names.
    """

    name: str
    lower: bool
    value: float
    free: float
    sigma: float
    probability: float
    moved: tuple[str, ...]
    resting: tuple[str, ...]

    @property
    def pull(self) -> float:
        """By how many sigma the data put the parameter beyond its bound."""
        return abs(self.free - self.value) / self.sigma

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the bounds."""
        return self.probability < FALSE_ALARM

    @property
    def record(self) -> dict[str, object]:
        """What the provenance has of it."""
        which = "min" if self.lower else "max"
        return {
            "value": self.value,
            "bound": which,
            "unbounded": self.free,
            "sigma": self.sigma,
            "probability": self.probability,
        }


def tested(outcome: Outcome, weak: Mapping[int, Prior], at: Mapping[int, float]) -> list[Limit]:
    """Test the bounds at which parameters are held.

    Parameters
    ----------
    outcome : Outcome
        With the parameters at their bounds.
    weak : mapping of int to Prior
        What is known beside data and bounds, by place of the parameter.
    at : mapping of int to float
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
    sigma, step = np.sqrt(np.diag(covariances)), free - theta
    held = list(at)
    beyond, covariance = step[held], covariances[np.ix_(held, held)]
    # more than one parameter that hardly differ make the covariance singular
    statistic = float(beyond @ np.linalg.lstsq(covariance, beyond, rcond=1e-12)[0])
    probability = max(float(scipy.special.chdtrc(len(at), statistic)), 1e-300)
    moves = step / sigma
    others = [k for k in range(outcome.shared) if k not in at and abs(moves[k]) > MOVES]
    names = [p.name for p in outcome.parameters]
    return [
        Limit(
            names[k],
            bool(step[k] < 0),
            bound,
            float(free[k]),
            float(sigma[k]),
            probability,
            tuple(f"{names[j]} by {moves[j]:+.2g} sigma" for j in others),
            tuple(names[j] for j in others),
        )
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
    where = "; ".join(
        f"{limit.name} is held at its {'lower' if limit.lower else 'upper'} bound {limit.value:.6g}, the "
        f"data put it at {limit.free:.6g} ± {limit.sigma:.2g}, {limit.pull:.2g} sigma beyond"
        for limit in limits
    )
    which = "the bound" if len(limits) == 1 else "the bounds"
    so = f"the data contradict {which}" if contradicted else "noise explains it"
    message = f"{where}; probability {limits[0].probability:.2g}: {so}"
    resting = [name for name in limits[0].resting if name in reported]
    moved = [text for text in limits[0].moved if text.split(" by ")[0] in reported]
    if moved:
        message += f"; without {which} these would move: {', '.join(moved)}"
    names = (*(limit.name for limit in limits), *resting)
    return [FitWarning("bound_contradicted" if contradicted else "at_bound", names, message)]
