"""Whether the data contradict what a user says of parameters: fixed values, bounds, ties and priors.

The joint model is fitted again with all of them released. By how much chi^2 falls is distributed as chi^2,
with one degree of freedom for each constraint that is active, if all of them are right.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from fit.estimate.irls import Outcome
from fit.fitting import Prior, constraints, parameter_values
from fit.settings import ParameterSettings
from fit.warnings import FitWarning

FALSE_ALARM = 1e-3  # probability with which noise contradicts constraints that are right


@dataclass(frozen=True)
class _Constraint:
    """One parameter of which the user says something; without that the data put it at `free`."""

    name: str
    words: str
    value: float
    free: float
    sigma: float
    is_at_bound: bool
    is_active: bool

    def __str__(self) -> str:
        return f"{self.words} (without: {self.free:.6g} ± {self.sigma:.2g})"


def warnings(outcome: Outcome) -> list[FitWarning]:
    """Report the constraints of a fit, which estimates are at a bound, and whether the data contradict any.

    Parameters
    ----------
    outcome : Outcome
        Of the fit.
    """
    problem, result, model = outcome.problem, outcome.result, outcome.model
    if problem is None or result is None or model is None or not problem.constrained.any():
        return []
    weak = {
        i: Prior(p.value, p.prior_sigma)
        for i, p in enumerate(outcome.parameters)
        if outcome.lost[i] or problem.constrained[i]
    }
    params = result.params.copy()
    for i, p in enumerate(params.values()):
        if problem.constrained[i]:
            p.set(vary=True, expr="", min=-np.inf, max=np.inf)
        p.user_data = weak.get(i, None if problem.constrained[i] else p.user_data)
    released = model.fit(params)
    free, sigma = parameter_values(released.params), np.sqrt(np.diag(model.covariance(released.params)))
    theta, reached = (
        parameter_values(result.params),
        constraints.at_bound(result.params, outcome.solution.sigma),
    )
    limited = [i for i in reached if not outcome.lost[i]]
    every = []
    for i, said in problem.chosen.items():
        if problem.constrained[i]:
            name = outcome.parameters[i].name
            words = constraints.described(name, said, float(theta[i]))
            active = i in limited or not _is_only_bounded(said)
            of_data = float(free[i]), float(sigma[i])
            every.append(_Constraint(name, words, float(theta[i]), *of_data, i in limited, active))
    return _reported(every, max(result.chisqr - released.chisqr, 0.0))


def _reported(every: list[_Constraint], excess: float) -> list[FitWarning]:
    """Return what is to be said if chi^2 falls by `excess` without the constraints."""
    words = "; ".join(map(str, every))
    found = [FitWarning("constrained", tuple(c.name for c in every), f"as the settings say: {words}")]
    if limited := [c for c in every if c.is_at_bound]:
        where = ", ".join(f"{c.name} = {c.value:.6g}" for c in limited)
        message = (
            f"the data put these at or beyond their bounds: {where}; their sigmas are those without bounds"
        )
        found.append(FitWarning("at_bound", tuple(c.name for c in limited), message))
    active = [c for c in every if c.is_active]
    probability = float(scipy.special.chdtrc(len(active), excess)) if active else 1.0
    if probability < FALSE_ALARM:
        message = (
            f"the data contradict the settings: {'; '.join(map(str, active))}; without, chi2 is less by "
            f"{excess:.4g} for {len(active)} degrees of freedom"
        )
        found.append(FitWarning("constraint_contradicted", tuple(c.name for c in active), message))
    return found


def _is_only_bounded(said: ParameterSettings) -> bool:
    return said.vary and said.expr is None and said.prior is None
