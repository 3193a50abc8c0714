"""Whether the data contradict the constraints of a fit: fixed values, bounds, ties and priors.

The joint model is fitted a second time without any of them, to runs whose noise is that of a fit without
constraints: what a wrong constraint leaves in the residual would pass for noise. If all of them are right,
chi^2 falls by an amount that is distributed as chi^2, with one degree of freedom for each active constraint
(likelihood-ratio test).
Noise attenuates the least-squares estimates of the coefficients of the capacitive read-outs (b_3 to b_6).
Their constraints are tested against the unattenuated estimates (see `fit.crosstalk`), by a Wald test whose
statistic is added. Without such estimates they are not tested.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from fit import false_alarms
from fit.findings import Finding
from fit.fitting import constraints
from fit.fitting.irls import IRLSResult
from fit.fitting.joint_model import Prior, free_directions, parameter_values
from fit.model import dynamics
from fit.units import concise_value

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]

ATTENUATED = tuple(name for name, (mean, _) in dynamics.CROSS_TALK.items() if mean in ("y", "z"))
SHIFT_SIGMA = 0.3  # sigma, by which an estimate must depend on the constraints to be named
SMALLEST_P = 1e-300  # smaller probabilities are not reported as such


@dataclass(frozen=True)
class TestedConstraint:
    """A constraint of one parameter.

    Attributes
    ----------
    name, description : str
        The parameter, and the constraint in words.
    value : float
        Constrained estimate, SI.
    unconstrained, sigma : float
        Estimate without any constraints, and its standard deviation, SI; NaN where it is not tested.
    bound : str
        ``"min"`` or ``"max"`` if the estimate is at that bound, else empty.
    is_declared : bool
        Whether the user states it; a physical limit of a parameter is not, nor what is assumed.
    is_active : bool
        Whether it takes part in the test: a bound does where the estimate is at it.
    """

    __test__ = False  # of the data, not of pytest

    name: str
    description: str
    value: float
    unconstrained: float
    sigma: float
    bound: str
    is_declared: bool
    is_active: bool

    @property
    def excess(self) -> float:
        """By how many sigma the unconstrained estimate is beyond the bound; negative within it."""
        side = -1.0 if self.bound == "min" else 1.0
        return side * (self.unconstrained - self.value) / self.sigma

    def __str__(self) -> str:
        if np.isnan(self.unconstrained):
            return self.description
        return f"{self.description} (without: {concise_value(self.unconstrained, self.sigma)})"

    def bound_message(self) -> str:
        """Return at which bound the estimate is, and where the data put it."""
        message = f"{self.name} is at its {_SIDES[self.bound]} bound {self.value:.6g}"
        if np.isnan(self.unconstrained):
            return message
        place = f"{self.excess:.2g} sigma beyond" if self.excess > 0 else "within it"
        unconstrained = concise_value(self.unconstrained, self.sigma)
        return f"{message}, the data put it at {unconstrained}, {place}"


@dataclass(frozen=True)
class UnattenuatedEstimates:
    """Estimates of a joint fit without the noise of the read-outs of motion.

    Attributes
    ----------
    constrained, unconstrained : ndarray, shape (P,)
        With and without the constraints, SI.
    covariance : ndarray, shape (P, P)
        Of those without; NaN where their error is unknown.
    """

    constrained: Array
    unconstrained: Array
    covariance: Array


@dataclass(frozen=True)
class ConstraintTest:
    """The constraints of a fit, tested together.

    Attributes
    ----------
    constraints : tuple of TestedConstraint
        All of them.
    delta_chi2 : float
        By how much chi^2 falls without the constraints, the Wald statistic of b_3 to b_6 included.
    shifts : dict of str to float
        Other parameters whose estimates depend on the constraints, and the shifts without them [sigma].
    """

    constraints: tuple[TestedConstraint, ...] = ()
    delta_chi2: float = 0.0
    shifts: dict[str, float] = field(default_factory=dict)

    @property
    def active(self) -> tuple[TestedConstraint, ...]:
        """The constraints that are tested."""
        return tuple(c for c in self.constraints if c.is_active)

    @property
    def at_bound(self) -> tuple[TestedConstraint, ...]:
        """The constraints of parameters whose estimates are at a bound."""
        return tuple(c for c in self.constraints if c.bound)

    @property
    def p_value(self) -> float:
        """Probability of a larger fall of chi^2 if all constraints are right, 1e-300 at least."""
        if not self.active:
            return 1.0
        return max(float(scipy.special.chdtrc(len(self.active), self.delta_chi2)), SMALLEST_P)

    @property
    def is_contradicted(self) -> bool:
        """Whether the data contradict the constraints."""
        return self.p_value < false_alarms.p_limit()

    def warnings(self) -> list[Finding]:
        """Return the constraints, the estimates at a bound, and whether the data contradict them."""
        warnings = []
        if declared := [c for c in self.constraints if c.is_declared]:
            message = f"with constraints: {'; '.join(map(str, declared))}"
            warnings.append(Finding("constrained", message, parameters=tuple(c.name for c in declared)))
        if self.at_bound:
            places = "; ".join(c.bound_message() for c in self.at_bound)
            message = f"{places}; the sigmas are those without bounds"
            warnings.append(Finding("at_bound", message, parameters=tuple(c.name for c in self.at_bound)))
        if self.is_contradicted:
            names = (*(c.name for c in self.active), *self.shifts)
            warnings.append(Finding("constraint_contradicted", self._contradiction(), parameters=names))
        return warnings

    def _contradiction(self) -> str:
        dof = len(self.active)
        message = (
            f"the data contradict the constraints: {'; '.join(map(str, self.active))}; without them chi2 is "
            f"less by {self.delta_chi2:.4g} for {dof} degree{'s' if dof > 1 else ''} of freedom"
        )
        if self.shifts:
            shifts = ", ".join(f"{name} by {shift:+.2g} sigma" for name, shift in self.shifts.items())
            message += f", and these estimates move: {shifts}"
        return message


_SIDES = {"min": "lower", "max": "upper"}


def refit_unconstrained(
    outcome: IRLSResult,
    declared: Collection[str] | None = None,
    *,
    reference: IRLSResult | None = None,
    unattenuated: UnattenuatedEstimates | None = None,
) -> ConstraintTest:
    """Test the constraints of a fit against its data.

    Parameters
    ----------
    outcome : IRLSResult
        The fit.
    declared : collection of str, optional
        Parameters whose constraints the user states; by default all.
    reference : IRLSResult, optional
        The fit without constraints, whose noise the test takes; by default that of `outcome`.
    unattenuated : UnattenuatedEstimates, optional
        Which b_3 to b_6 are tested against.
    """
    parameter_set, result, model = outcome.parameter_set, outcome.result, outcome.model
    if parameter_set is None or result is None or model is None or not parameter_set.constrained.any():
        return ConstraintTest()
    names, constrained = [p.name for p in outcome.parameters], result
    if reference and reference.model and [p.name for p in reference.parameters] == names:
        model = reference.model
        constrained = model.fit(result.params)
    is_attenuated = np.array([name.startswith(ATTENUATED) for name in names])
    params = result.params.copy()
    for i, (p, parameter) in enumerate(zip(params.values(), outcome.parameters, strict=True)):
        if parameter_set.constrained[i] and not is_attenuated[i]:
            p.set(vary=True, expr="", min=-np.inf, max=np.inf)
            p.user_data = Prior(parameter.value, parameter.prior_sigma)
    unconstrained = model.fit(params)
    free, theta = parameter_values(unconstrained.params), parameter_values(result.params)
    sigma = np.sqrt(np.diag(model.covariance(unconstrained.params)))
    shifts = (free - theta) / np.where(sigma > 0, sigma, 1.0)
    free[is_attenuated] = sigma[is_attenuated] = np.nan
    delta_chi2, estimates = max(constrained.chisqr - unconstrained.chisqr, 0.0), result.params
    if unattenuated:
        variance = np.diag(unattenuated.covariance)
        shifts = (unattenuated.unconstrained - unattenuated.constrained) / np.sqrt(variance)
        estimates = constraints.params_at(
            result.params, np.where(is_attenuated, unattenuated.constrained, theta)
        )
        free = np.where(is_attenuated & np.isfinite(variance), unattenuated.unconstrained, free)
        sigma = np.where(is_attenuated, np.sqrt(variance), sigma)
    tested = _tested_constraints(outcome, declared, estimates, free, sigma)
    if unattenuated:
        active = [i for i, c in tested.items() if c.is_active and is_attenuated[i]]
        delta_chi2 += _wald_statistic(estimates, unattenuated, active)
    dependent = [
        i
        for i in range(outcome.shared)
        if not parameter_set.constrained[i] and not outcome.undetermined[i] and abs(shifts[i]) > SHIFT_SIGMA
    ]
    return ConstraintTest(tuple(tested.values()), delta_chi2, {names[i]: float(shifts[i]) for i in dependent})


def _tested_constraints(
    outcome: IRLSResult,
    declared: Collection[str] | None,
    estimates: lmfit.Parameters,
    unconstrained: Array,
    sigma: Array,
) -> dict[int, TestedConstraint]:
    """Return the constraints by place of the parameter.

    `unconstrained` and its `sigma`, shape (P,), are NaN where a constraint is not tested.
    """
    assert outcome.parameter_set
    theta, bounds = parameter_values(estimates), constraints.at_bound(estimates, outcome.solution.sigma)
    tested = {}
    for i, setting in outcome.parameter_set.settings.items():
        if not outcome.parameter_set.constrained[i]:
            continue
        name, bound = outcome.parameters[i].name, "" if outcome.undetermined[i] else bounds.get(i, "")
        tested[i] = TestedConstraint(
            name=name,
            description=setting.describe(name, float(theta[i])),
            value=float(theta[i]),
            unconstrained=float(unconstrained[i]),
            sigma=float(sigma[i]),
            bound=bound,
            is_declared=i not in outcome.parameter_set.assumed and (declared is None or name in declared),
            is_active=bool(np.isfinite(unconstrained[i])) and (bool(bound) or not setting.is_only_bounded),
        )
    return tested


def _wald_statistic(
    params: lmfit.Parameters, unattenuated: UnattenuatedEstimates, active: Sequence[int]
) -> float:
    """Return the Wald statistic of the constraints of the `active` parameters, by their place.

    `params` have their constrained values. A parameter at its bound or with a prior is constrained to its
    own value, a tied one to that of its expression.
    """
    if not active:
        return 0.0
    is_dependent, rows = constraints.fixed_or_tied(params), np.eye(len(params))
    rows[:, ~is_dependent] -= free_directions(params)
    rows[~is_dependent] = np.eye(len(params))[~is_dependent]
    target, variance = parameter_values(params), np.zeros(len(params))
    at_bound = constraints.at_bound(params, np.sqrt(np.diag(unattenuated.covariance)))
    for i, p in enumerate(params.values()):
        if isinstance(p.user_data, Prior) and not is_dependent[i] and i not in at_bound:
            target[i], variance[i] = p.user_data.mean, p.user_data.sigma**2
    rows = rows[active]
    covariance = np.nan_to_num(unattenuated.covariance)
    excess = rows @ (unattenuated.unconstrained - target)
    return float(excess @ np.linalg.solve(rows @ covariance @ rows.T + np.diag(variance[active]), excess))
