"""Whether the data contradict the constraints of a fit: fixed values, bounds, ties and priors.

The joint model is fitted a second time without any of them. If all of them are right, chi^2 falls by an
amount that is distributed as chi^2, with one degree of freedom for each active constraint (likelihood-ratio
test).
Coefficients of the capacitive read-outs (b_3 to b_6) are not tested: the noise of these read-outs attenuates
their least-squares estimates (see `fit.crosstalk`).
"""

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
import scipy

from fit import false_alarms
from fit.fitting import constraints
from fit.fitting.irls import IRLSResult
from fit.fitting.joint_model import Prior, parameter_values
from fit.model import dynamics
from fit.warnings import FitWarning

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
        Estimate without any constraints, and its standard deviation, SI.
    bound : str
        ``"min"`` or ``"max"`` if the estimate is at that bound, else empty.
    is_declared : bool
        Whether the user states it; a physical limit of a parameter is not.
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
        if self.name.startswith(ATTENUATED):
            return self.description
        return f"{self.description} (without: {self.unconstrained:.6g} ± {self.sigma:.2g})"

    def bound_message(self) -> str:
        """Return at which bound the estimate is, and where the data put it."""
        message = f"{self.name} is at its {_SIDES[self.bound]} bound {self.value:.6g}"
        if self.name.startswith(ATTENUATED):
            return message
        place = f"{self.excess:.2g} sigma beyond" if self.excess > 0 else "within it"
        return f"{message}, the data put it at {self.unconstrained:.6g} ± {self.sigma:.2g}, {place}"


@dataclass(frozen=True)
class ConstraintTest:
    """The constraints of a fit, tested together.

    Attributes
    ----------
    constraints : tuple of TestedConstraint
        All of them.
    delta_chi2 : float
        By how much chi^2 falls without the constraints.
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
        return self.p_value < false_alarms.p_limit("constraints")

    def warnings(self) -> list[FitWarning]:
        """Return the constraints, the estimates at a bound, and whether the data contradict them."""
        warnings = []
        if declared := [c for c in self.constraints if c.is_declared]:
            message = f"as the settings say: {'; '.join(map(str, declared))}"
            warnings.append(FitWarning("constrained", tuple(c.name for c in declared), message))
        if self.at_bound:
            places = "; ".join(c.bound_message() for c in self.at_bound)
            message = f"{places}; the sigmas are those without bounds"
            warnings.append(FitWarning("at_bound", tuple(c.name for c in self.at_bound), message))
        if self.is_contradicted:
            names = (*(c.name for c in self.active), *self.shifts)
            warnings.append(FitWarning("constraint_contradicted", names, self._contradiction()))
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


def refit_unconstrained(outcome: IRLSResult, declared: Collection[str] | None = None) -> ConstraintTest:
    """Test the constraints of a fit against its data.

    Parameters
    ----------
    outcome : IRLSResult
        The fit.
    declared : collection of str, optional
        Parameters whose constraints the user states; by default all.
    """
    parameter_set, result, model = outcome.parameter_set, outcome.result, outcome.model
    if parameter_set is None or result is None or model is None or not parameter_set.constrained.any():
        return ConstraintTest()
    names = [p.name for p in outcome.parameters]
    params = result.params.copy()
    for i, (p, parameter) in enumerate(zip(params.values(), outcome.parameters, strict=True)):
        if parameter_set.constrained[i] and not parameter.name.startswith(ATTENUATED):
            p.set(vary=True, expr="", min=-np.inf, max=np.inf)
            p.user_data = Prior(parameter.value, parameter.prior_sigma)
    unconstrained = model.fit(params)
    free, theta = parameter_values(unconstrained.params), parameter_values(result.params)
    sigma = np.sqrt(np.diag(model.covariance(unconstrained.params)))
    bounds = constraints.at_bound(result.params, outcome.solution.sigma)
    tested = []
    for i, setting in parameter_set.settings.items():
        if not parameter_set.constrained[i]:
            continue
        bound = "" if outcome.undetermined[i] else bounds.get(i, "")
        is_tested = not names[i].startswith(ATTENUATED)
        tested.append(
            TestedConstraint(
                name=names[i],
                description=constraints.describe(names[i], setting, float(theta[i])),
                value=float(theta[i]),
                unconstrained=float(free[i]),
                sigma=float(sigma[i]),
                bound=bound,
                is_declared=declared is None or names[i] in declared,
                is_active=is_tested and (bool(bound) or not setting.is_only_bounded),
            )
        )
    shifts = (free - theta) / np.where(sigma > 0, sigma, 1.0)
    dependent = [
        i
        for i in range(outcome.shared)
        if not parameter_set.constrained[i] and not outcome.undetermined[i] and abs(shifts[i]) > SHIFT_SIGMA
    ]
    return ConstraintTest(
        tuple(tested),
        max(result.chisqr - unconstrained.chisqr, 0.0),
        {names[i]: float(shifts[i]) for i in dependent},
    )


def descriptions(outcome: IRLSResult) -> list[str]:
    """Return the constraints of a fit in words."""
    settings = outcome.parameter_set.settings if outcome.parameter_set else {}
    return [
        constraints.describe(outcome.parameters[i].name, constraint, float(outcome.solution.theta[i]))
        for i, constraint in settings.items()
        if constraint.is_constraint
    ]
