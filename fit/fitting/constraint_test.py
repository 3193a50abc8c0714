"""Whether the data contradict what a user says of parameters: fixed values, bounds, ties and priors.

The joint model is fitted again without any of them. By how much chi^2 falls is distributed as chi^2, with one
degree of freedom for each constraint that is active, if all of them are right. Coefficients of the capacitive
read-outs (b_3 to b_6) are not tested: the noise of these attenuates what least squares finds (see `bump`).
"""

from dataclasses import dataclass

import numpy as np
import scipy

from fit.fitting import constraints
from fit.fitting.irls import IRLSResult
from fit.fitting.joint_model import Prior, parameter_values
from fit.model import dynamics
from fit.settings import ParameterSettings
from fit.warnings import FitWarning

ATTENUATED = tuple(name for name, (mean, _) in dynamics.CROSS_TALK.items() if mean in ("y", "z"))
FALSE_ALARM = 1e-3  # probability with which noise contradicts constraints that are right


@dataclass(frozen=True)
class _Constraint:
    """A constraint of one parameter, which the data put at `free` ± `sigma` without any."""

    name: str
    words: str
    value: float
    free: float
    sigma: float
    is_at_bound: bool
    is_active: bool

    def __str__(self) -> str:
        if self.name.startswith(ATTENUATED):
            return self.words
        return f"{self.words} (without: {self.free:.6g} ± {self.sigma:.2g})"


def warnings(outcome: IRLSResult) -> list[FitWarning]:
    """Report the constraints of a fit, which estimates are at a bound, and whether the data contradict any.

    Parameters
    ----------
    outcome : IRLSResult
        Of the fit.
    """
    problem, result, model = outcome.problem, outcome.result, outcome.model
    if problem is None or result is None or model is None or not problem.constrained.any():
        return []
    params = result.params.copy()
    for i, (p, parameter) in enumerate(zip(params.values(), outcome.parameters, strict=True)):
        if problem.constrained[i] and not parameter.name.startswith(ATTENUATED):
            p.set(vary=True, expr="", min=-np.inf, max=np.inf)
            p.user_data = Prior(parameter.value, parameter.prior_sigma)
    unconstrained = model.fit(params)
    free = parameter_values(unconstrained.params)
    sigma = np.sqrt(np.diag(model.covariance(unconstrained.params)))
    theta = parameter_values(result.params)
    reached = constraints.at_bound(result.params, outcome.solution.sigma)
    bounded = [i for i in reached if not outcome.lost[i]]
    tested = []
    for i, constraint in problem.settings.items():
        if problem.constrained[i]:
            name = outcome.parameters[i].name
            words = constraints.describe(name, constraint, float(theta[i]))
            tells = not name.startswith(ATTENUATED)
            active = tells and (i in bounded or not _is_only_bounded(constraint))
            of_data = float(free[i]), float(sigma[i])
            tested.append(_Constraint(name, words, float(theta[i]), *of_data, i in bounded, active))
    return _warnings(tested, max(result.chisqr - unconstrained.chisqr, 0.0))


def descriptions(outcome: IRLSResult) -> list[str]:
    """Return the constraints of a fit in words."""
    settings = outcome.problem.settings if outcome.problem else {}
    return [
        constraints.describe(outcome.parameters[i].name, constraint, float(outcome.solution.theta[i]))
        for i, constraint in settings.items()
        if constraint.is_constraint
    ]


def _warnings(tested: list[_Constraint], excess: float) -> list[FitWarning]:
    """Return what to report if chi^2 falls by `excess` without the constraints."""
    words = "; ".join(map(str, tested))
    reported = [FitWarning("constrained", tuple(c.name for c in tested), f"as the settings say: {words}")]
    if bounded := [c for c in tested if c.is_at_bound]:
        where = ", ".join(f"{c.name} = {c.value:.6g}" for c in bounded)
        message = (
            f"the data put these at or beyond their bounds: {where}; their sigmas are those without bounds"
        )
        reported.append(FitWarning("at_bound", tuple(c.name for c in bounded), message))
    active = [c for c in tested if c.is_active]
    probability = float(scipy.special.chdtrc(len(active), excess)) if active else 1.0
    if probability < FALSE_ALARM:
        message = (
            f"the data contradict the settings: {'; '.join(map(str, active))}; without, chi2 is less by "
            f"{excess:.4g} for {len(active)} degree{'s' if len(active) > 1 else ''} of freedom"
        )
        reported.append(FitWarning("constraint_contradicted", tuple(c.name for c in active), message))
    return reported


def _is_only_bounded(constraint: ParameterSettings) -> bool:
    return constraint.vary and constraint.expr is None and constraint.prior is None
