"""A joint model and its estimate by lmfit: refits, fits without some of the runs, confidence intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from fit.errors import InputError, shown
from fit.files import closest_match
from fit.fitting import constraints
from fit.fitting.joint_model import Array, JointModel, Prior, free_directions
from fit.fitting.null_space import null_space

if TYPE_CHECKING:
    import lmfit
    from lmfit.minimizer import MinimizerResult


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
        constraints.table(params)  # refuses what is none
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

    def shift_sigma(self, reduced: MinimizerResult, *runs: str) -> Array:
        """Return the standard deviations of the shifts of all P parameters, shape (P,), without some runs.

        With J the derivatives of the residual of a run and C, C' the inverse informations with and without
        `runs`, the noise e of a run shifts the estimates by ``(C - C') J^T e``, of those left out by
        ``C J^T e``. Their covariance includes the error of the PSDs.

        Parameters
        ----------
        reduced : MinimizerResult
            The fit without them, see `exclude`.
        *runs : str
            Names of experiments.
        """
        params, submodel = self.result.params, self.model.exclude(*runs)
        left_out = JointModel([run for run in self.model.runs if run.name in runs])
        C, C_reduced = self.model.inverse_information(params), submodel.inverse_information(reduced.params)
        J = submodel.gradient(reduced.params)
        shift_of_others = C - C_reduced
        covariance = shift_of_others @ (J.T @ J + submodel.psd_scores(params)) @ shift_of_others
        covariance += C @ (left_out.information(params) + left_out.psd_scores(params)) @ C
        return np.asarray(np.sqrt(np.diag(covariance)))

    def _fit(self, model: JointModel, params: lmfit.Parameters) -> MinimizerResult:
        """Fit with weak priors of what is not determined."""
        constrained, widths = params.copy(), np.array([prior.sigma for prior in self.weak])
        J = model.gradient(constrained)
        undetermined = null_space(J.T @ J, widths, free_directions(constrained)).undetermined
        for p, prior, is_weak in zip(constrained.values(), self.weak, undetermined, strict=True):
            if is_weak and p.vary and not p.expr and p.user_data is None:
                p.user_data = prior
        return model.fit(constrained)


def delta_chi2(best: MinimizerResult, new: MinimizerResult) -> float:
    """Return the probability of a smaller difference of chisqr, for `lmfit.conf_interval`.

    lmfit's default, an F test, is for sigmas that are known up to a factor. Those of a calibration are
    known: the difference that one fixed parameter makes is distributed as chi^2 with one degree of freedom.

    Parameters
    ----------
    best, new : MinimizerResult
        The best fit, and one with a parameter fixed.

    Raises
    ------
    InputError
        If one of them is no result of lmfit.
    """
    from lmfit.minimizer import MinimizerResult  # slow to import

    for result in (best, new):
        if not isinstance(result, MinimizerResult):
            raise InputError(f"delta_chi2: {shown(result)}, expected an lmfit MinimizerResult")
    return float(scipy.special.chdtr(max(new.nfree - best.nfree, 1), max(new.chisqr - best.chisqr, 0.0)))
