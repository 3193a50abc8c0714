"""A joint model and its estimate by lmfit: refits, fits without some of the runs, profile likelihood."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from fit.errors import InputError
from fit.files import closest_match
from fit.fitting.joint_model import JointModel, Prior
from fit.fitting.null_space import null_space

if TYPE_CHECKING:
    import lmfit
    from lmfit.minimizer import MinimizerResult

PROFILE_TOLERANCE = 0.01  # of the distance from the estimate: the last step, whose error is that squared
PROFILE_STEPS = 20


@dataclass(frozen=True)
class SolvedModel:
    """A joint model and what lmfit made of it.

    Attributes
    ----------
    model : JointModel
        The compressed runs.
    result : MinimizerResult
        The estimate: params, covar (the true covariance), chisqr and nfree (of the consistency of the runs).
    weak : sequence of Prior
        Of each of the P parameters, for where the data do not determine it.
    """

    model: JointModel
    result: MinimizerResult
    weak: Sequence[Prior]

    @property
    def minimizer(self) -> lmfit.Minimizer:
        """The problem as lmfit has it, at the estimate, for any of its methods."""
        # without derivatives: scalar minimisers would take those of the residual for those of chi^2
        import lmfit  # slow to import

        return lmfit.Minimizer(self.model.residual, self.result.params, scale_covar=False)

    def refit(self, params: lmfit.Parameters) -> MinimizerResult:
        """Return the fit with other settings of its parameters.

        Parameters
        ----------
        params : lmfit.Parameters
            In any order; those that are absent are as in `result`.

        Raises
        ------
        InputError
            If one is no parameter of this fit, or its value or prior is not valid.
        """
        check_params(params)
        merged = self.result.params.copy()
        for name, p in params.items():
            if name not in merged:
                raise InputError(f"params: {name}: no parameter of this fit{closest_match(name, merged)}")
            if not np.isfinite(p.value):
                raise InputError(f"params: {name}: value: {p.value}, expected a finite number")
        merged.update(params.copy())
        merged.update_constraints()
        return self._fit(self.model, merged)

    def exclude(self, *runs: str) -> MinimizerResult:
        """Return the fit without some of the experiments.

        Raises
        ------
        InputError
            If there is none of a name, or none remains.
        """
        names = [run.name for run in self.model.runs]
        for name in runs:
            if name not in names:
                raise InputError(f"{name}: no experiment of this fit{closest_match(str(name), names)}")
        if {*runs} == {*names}:
            raise InputError(f"{', '.join(runs)}: all experiments of this fit, expected one that remains")
        return self._fit(self.model.exclude(*runs), self.result.params)

    def profile_limits(self, name: str, levels: Sequence[float]) -> tuple[float | None, ...]:
        """Return where the profile likelihood of a parameter that varies falls by numbers of sigma.

        There chi^2 exceeds its minimum by ``level**2``, whatever the other parameters; a negative level is
        that below the estimate. None beyond a bound of the parameter.
        """
        estimate, fixed = self.result.params[name], self.result.params.copy()
        fixed[name].set(vary=False, min=-np.inf, max=np.inf)
        sigma, limits = float(estimate.stderr), []
        for level in levels:
            limit, sigma = self._profile_limit(fixed, name, level, sigma)
            is_valid = limit is not None and estimate.min <= limit <= estimate.max
            limits.append(limit if is_valid else None)
        return tuple(limits)

    def _profile_limit(
        self, fixed: lmfit.Parameters, name: str, level: float, sigma: float
    ) -> tuple[float | None, float]:
        """Return a limit, None if it is not reached, and its distance from the estimate per sigma of `level`.

        The root of the increase of chi^2 is all but proportional to the distance, `sigma` a first guess of
        its slope: each step scales the distance to the level.
        """
        estimate = self.result.params[name]
        for _ in range(PROFILE_STEPS):
            fixed[name].value = estimate.value + level * sigma
            increase = self.model.fit(fixed).chisqr - self.result.chisqr
            if increase <= 0:
                break
            previous, sigma = sigma, sigma * abs(level) / math.sqrt(increase)
            if abs(sigma - previous) < PROFILE_TOLERANCE * sigma:
                return float(estimate.value + level * sigma), sigma
        return None, float(estimate.stderr)

    def _fit(self, model: JointModel, params: lmfit.Parameters) -> MinimizerResult:
        """Fit with weak priors of what is not determined."""
        constrained, widths = params.copy(), np.array([prior.sigma for prior in self.weak])
        J = model.gradient(constrained)
        for p, prior, undetermined in zip(
            constrained.values(), self.weak, null_space(J.T @ J, widths)[0], strict=True
        ):
            if undetermined and p.vary and not p.expr and p.user_data is None:
                p.user_data = prior
        return model.fit(constrained)


def check_params(params: object) -> None:
    """Check the parameters that a user gives.

    Raises
    ------
    InputError
        If they are no lmfit.Parameters, a bound is no number, or a prior is no `Prior` of a finite mean and a
        positive sigma.
    """
    import lmfit  # slow to import

    if not isinstance(params, lmfit.Parameters):
        raise InputError(f"params: {type(params).__name__}, expected lmfit.Parameters (fit.make_params)")
    for name, p in params.items():
        if np.isnan([p.min, p.max]).any():
            raise InputError(f"params: {name}: min: {p.min}, max: {p.max}, expected numbers")
        if p.user_data is not None and not _is_valid_prior(p.user_data):
            raise InputError(
                f"params: {name}: user_data: expected fit.Prior(mean, sigma) of a finite mean and "
                "a positive sigma"
            )


def _is_valid_prior(prior: object) -> bool:
    if not isinstance(prior, Prior) or not all(isinstance(x, Real) for x in prior):
        return False
    return bool(np.isfinite(prior).all() and prior.sigma > 0)
