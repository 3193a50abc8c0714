"""The parameters of a fit as lmfit has them, with all prior knowledge of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.fitting import constraints
from fit.fitting.joint_model import JointModel, Prior, lmfit_names, lmfit_params, parameter_values
from fit.fitting.priors import PriorSet, prior_rows
from fit.fitting.random_effects import FREE, ScaleParameter
from fit.parameters import Parameter
from fit.settings import ParameterSettings
from fit.whitening import whitened_run

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]

MAX_START_SHIFT = 30.0  # widths of the weak prior, from the flight value within which a fit starts


class ParameterSet:
    """The P parameters of a fit.

    Parameters
    ----------
    parameters : sequence of Parameter
        The parameters.
    random_effects : sequence of ScaleParameter
        Departures of experiments among them, with priors so weak that the data determine them.
    settings : mapping of str to ParameterSettings
        What the user says of them, by name.

    Attributes
    ----------
    settings : dict of int to ParameterSettings
        What the user says, or what is assumed otherwise, by place of the parameter.
    assumed : set of int
        Places of those that are assumed.
    constrained : ndarray of bool, shape (P,)
        Of which parameters that is more than where a fit starts.
    """

    def __init__(
        self,
        parameters: Sequence[Parameter],
        random_effects: Sequence[ScaleParameter] = (),
        settings: Mapping[str, ParameterSettings] | None = None,
    ) -> None:
        by_name = settings or {}
        self._names = lmfit_names(p.name for p in parameters)
        self._flight = np.array([p.value for p in parameters])
        self._widths = np.array([p.prior_sigma for p in parameters])
        self._deviations = {
            i: prior for width in random_effects for i, prior in width.priors(FREE * width.scale).items()
        }
        self.settings = {i: by_name[p.name] for i, p in enumerate(parameters) if p.name in by_name}
        assumed = {
            i: ParameterSettings(prior=(p.value, p.assumed_sigma))
            for i, p in enumerate(parameters)
            if p.assumed_sigma and not (i in self.settings and self.settings[i].is_constraint)
        }
        self.settings, self.assumed = {**self.settings, **assumed}, {*assumed}
        self._priors = {
            i: Prior(*constraint.prior) for i, constraint in self.settings.items() if constraint.prior
        }
        flags = [i in self.settings and self.settings[i].is_constraint for i in range(len(self._names))]
        self.constrained = np.array(flags, dtype=bool)

    def start(self) -> Array:
        """Return where a fit starts, shape (P,)."""
        params = lmfit_params(self._names, self._flight, {})
        try:
            with np.errstate(all="ignore"):
                constraints.constrain(params, self.settings, start=True)
                theta = parameter_values(params)
        except (ArithmeticError, ValueError, TypeError, RuntimeError) as error:
            raise InputError(f"fit.parameters: {self._ties()}: no number where the fit starts") from error
        shift = np.abs(theta - self._flight) / self._widths
        for i, constraint in self.settings.items():
            if not shift[i] < MAX_START_SHIFT:
                low, high = (self._flight[i] + side * MAX_START_SHIFT * self._widths[i] for side in (-1, 1))
                source = constraint.expr or theta[i]
                raise InputError(
                    f"fit.parameters.{self._names[i]}: {source} leads to {theta[i]:.6g} where the fit "
                    f"starts, expected {low:.3g} to {high:.3g}"
                )
        return theta

    def _ties(self) -> str:
        return "; ".join(
            f"{self._names[i]} = {constraint.expr}"
            for i, constraint in self.settings.items()
            if constraint.expr
        )

    def params(self, theta: Array, weak: Mapping[int, Prior] | None = None) -> lmfit.Parameters:
        """Return the parameters at theta, shape (P,), with weak priors of some by their place."""
        params = lmfit_params(self._names, theta, {**(weak or {}), **self._deviations})
        constraints.constrain(params, self.settings, start=False)
        return params

    def known(self, theta: Array) -> Array:
        """Return the prior knowledge, weak priors apart, as rows of chi^2, shape (N, P)."""
        rows = prior_rows({**self._deviations, **self._priors}, theta.size)
        if not self.constrained.any():
            return rows
        return np.concatenate([rows, constraints.constraint_rows(self.params(theta), self._widths)[0]])

    def prior(self, params: lmfit.Parameters, weak: PriorSet) -> whitened_run.Prior:
        """Return all prior knowledge but that of the departures."""
        theta, known = parameter_values(params), weak.rows(self._priors)
        rows = constraints.constraint_rows(params, self._widths)[0]
        if not len(rows):
            return known
        follows = rows * (constraints.TIGHT * self._widths[constraints.fixed_or_tied(params), None])
        centre = known.centre.copy()
        centre[constraints.fixed_or_tied(params)] = 0.0
        centre[constraints.fixed_or_tied(params)] = follows @ (theta - centre)
        return whitened_run.Prior(centre, np.concatenate([known.rows, rows]))

    def covariance(self, model: JointModel, params: lmfit.Parameters) -> Array:
        """Return the covariance at a minimum, shape (P, P), positive for what is fixed or tied as well."""
        slack = constraints.TIGHT * self._widths * constraints.fixed_or_tied(params)
        covariance = model.covariance(params) + np.diag(slack**2)
        if not np.all(np.diag(covariance) > 0):
            raise FitError(
                "ill-conditioned beyond what numbers hold; expected channels in the units they name"
            )
        return covariance
