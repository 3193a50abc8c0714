"""Whether the data contradict the constraints of a fit: fixed values, bounds, ties and priors.

The joint model is fitted a second time without any of them, to runs whose noise is that of a fit without
constraints: what a wrong constraint leaves in the residual would pass for noise. If all of them are right,
chi^2 falls by an amount that is distributed as chi^2, with one degree of freedom for each active constraint
(likelihood-ratio test). Noise attenuates the estimates of the coefficients of the capacitive read-outs (b_3
to b_6), so that their constraints are not tested.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from fit import false_alarms
from fit.findings import Finding
from fit.fitting.irls import IRLSResult
from fit.fitting.joint_model import Prior, parameter_values
from fit.model import dynamics
from fit.tables import FIXED
from fit.units import concise_value

ATTENUATED = tuple(name for name, (mean, _) in dynamics.CROSS_TALK.items() if mean in ("y", "z"))
SHIFT_SIGMA = 0.3  # sigma, by which an estimate must depend on the constraints to be named
SMALLEST_P = 1e-300  # smaller probabilities are not reported as such


@dataclass(frozen=True)
class ConstraintTest:
    """The constraints of a fit, tested together.

    Attributes
    ----------
    active : tuple of str
        Parameters whose constraints are tested: those with a bound where the estimate is at it.
    delta_chi2 : float
        By how much chi^2 falls without the constraints.
    warnings : tuple of Finding
        The constraints, the estimates at a bound, and whether the data contradict them.
    """

    active: tuple[str, ...] = ()
    delta_chi2: float = 0.0
    warnings: tuple[Finding, ...] = ()

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


def refit_unconstrained(
    outcome: IRLSResult, declared: Collection[str] | None = None, reference: IRLSResult | None = None
) -> ConstraintTest:
    """Test the constraints of a fit against its data.

    Parameters
    ----------
    outcome : IRLSResult
        The fit.
    declared : collection of str, optional
        Parameters whose constraints the user states; by default all but those that are assumed.
    reference : IRLSResult, optional
        The fit without constraints, whose noise the test takes; by default that of `outcome`.
    """
    names, stated = [p.name for p in outcome.parameters], outcome.constraints
    if not stated:
        return ConstraintTest()
    model, constrained = outcome.model, outcome.result
    if reference and [p.name for p in reference.parameters] == names:
        model = reference.model
        constrained = model.fit(constrained.params)
    params = outcome.result.params.copy()
    for i, (p, parameter) in enumerate(zip(params.values(), outcome.parameters, strict=True)):
        if i in stated and not parameter.name.startswith(ATTENUATED):
            p.set(vary=True, expr="", min=-np.inf, max=np.inf)
            p.user_data = Prior(parameter.value, parameter.prior_sigma)
    free = model.fit(params)
    theta, sigma = parameter_values(free.params), np.sqrt(np.diag(model.covariance(free.params)))
    if declared is None:
        assumed = (p.assumed_sigma and Prior(p.value, p.assumed_sigma) for p in outcome.parameters)
        given = zip(names, outcome.stated.values(), assumed, strict=True)
        declared = [name for name, p, prior in given if not prior or p.user_data != prior]
    known = [i for i in range(outcome.shared) if i in stated or not outcome.undetermined[i]]
    return compare(
        {names[i]: text for i, text in stated.items()},
        {names[i]: bound for i, bound in outcome.bounds().items()},
        dict(zip(names, outcome.solution.theta.tolist(), strict=True)),
        {names[i]: (float(theta[i]), float(sigma[i])) for i in known if not names[i].startswith(ATTENUATED)},
        constrained.chisqr - free.chisqr,
        declared,
    )


def compare(
    stated: Mapping[str, str],
    bounds: Mapping[str, float],
    values: Mapping[str, float],
    free: Mapping[str, tuple[float, float]],
    delta_chi2: float,
    declared: Collection[str] | None = None,
) -> ConstraintTest:
    """Compare a fit with constraints and the fit without.

    Parameters
    ----------
    stated : mapping of str to str
        The constraints in words, by parameter.
    bounds : mapping of str to float
        Bounds that estimates are at.
    values : mapping of str to float
        Estimates with the constraints.
    free : mapping of str to tuple of float
        Estimates without, and their sigmas, of all parameters that are tested or determined.
    delta_chi2 : float
        By how much chi^2 falls without the constraints.
    declared : collection of str, optional
        Parameters whose constraints the user states, and not the physics; by default all.
    """
    active = tuple(n for n, text in stated.items() if n in free and (n in bounds or text[:6] != "bounds"))
    test = ConstraintTest(active, max(float(delta_chi2), 0.0))
    words = {
        name: f"{name} {text}"
        + (f" at {values[name]:.9g}" if text == FIXED else "")
        + (f" (without: {concise_value(*free[name])})" if name in free else "")
        for name, text in stated.items()
    }
    warnings: list[Finding] = []
    if named := tuple(name for name in words if declared is None or name in declared):
        message = f"with constraints: {'; '.join(words[name] for name in named)}"
        warnings.append(Finding("constrained", message, parameters=named))
    if bounds:
        places = (
            f"{name} is at its bound {bound:.6g}"
            + (f", the data put it at {concise_value(*free[name])}" if name in free else "")
            for name, bound in bounds.items()
        )
        message = f"{'; '.join(places)}; the sigmas are those without bounds"
        warnings.append(Finding("at_bound", message, parameters=tuple(bounds)))
    if test.is_contradicted:
        shifts = {
            name: (value - values[name]) / sigma
            for name, (value, sigma) in free.items()
            if name not in words and abs(value - values[name]) > SHIFT_SIGMA * sigma
        }
        dof = len(active)
        message = (
            f"the data contradict the constraints: {'; '.join(words[name] for name in active)}; without "
            f"them chi2 is less by {test.delta_chi2:.4g} for {dof} degree{'s' if dof > 1 else ''} of freedom"
        )
        shifted = ", ".join(f"{name} by {shift:+.2g} sigma" for name, shift in shifts.items())
        message += f", and these estimates move: {shifted}" if shifted else ""
        warnings.append(Finding("constraint_contradicted", message, parameters=(*active, *shifts)))
    return replace(test, warnings=tuple(warnings))
