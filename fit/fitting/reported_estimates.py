"""Estimates of a fit as results have them: with their constraints, and exact values without sigma."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.findings import Finding
from fit.fitting import constraints
from fit.fitting.irls import IRLSResult
from fit.fitting.joint_model import lmfit_symbol, parameter_values
from fit.results import Constraint, ConstraintKind, Estimate, Fit
from fit.whitening import Experiment

Array = NDArray[np.float64]

_SYMBOL = re.compile(r"[A-Za-z_]\w*")


def reported_estimates(
    outcome: IRLSResult,
    names: Mapping[int, str],
    values: Array | None = None,
    covariance: Array | None = None,
) -> tuple[dict[str, Estimate], Array]:
    """Return estimates of a fit, and their covariance.

    Inside a fit, fixed and tied parameters have a sigma of `constraints.TIGHT` widths of their weak priors.
    Here exact values are exact, and their rows and columns of the covariance zero.

    Parameters
    ----------
    outcome : IRLSResult
        Of the fit, with P parameters.
    names : mapping of int to str
        By place of the N parameters that are reported, their names in the results.
    values, covariance : ndarray, shapes (N,) and (N, N), optional
        Other estimates of these N than those of least squares, such as unattenuated ones.

    Returns
    -------
    estimates : dict of str to Estimate
        In the order of `names`.
    covariance : ndarray, shape (N, N)
        Theirs.

    Raises
    ------
    FitError
        If a sigma is no positive number.
    """
    places, theta = list(names), outcome.solution.theta.copy()
    if values is not None:
        theta[places] = values
    if outcome.result is not None:
        theta = np.where(outcome.exact, parameter_values(outcome.result.params), theta)
    if covariance is None:
        covariance = outcome.solution.covariance[np.ix_(places, places)]
    sigma = np.append(outcome.solution.sigma, np.sqrt(np.diag(covariance)))
    if not np.all(np.isfinite(sigma) & (sigma > 0)):
        raise FitError("a sigma is not a positive number")
    is_free = ~outcome.exact[places]
    covariance = covariance * np.outer(is_free, is_free)
    stated = _constraints(outcome, theta)
    estimates = {
        names[i]: Estimate(float(theta[i]), sigma, outcome.parameters[i].unit, constraint=stated.get(i))
        for i, sigma in zip(places, np.sqrt(np.diag(covariance)).tolist(), strict=True)
    }
    return estimates, covariance


def _constraints(outcome: IRLSResult, theta: Array) -> dict[int, Constraint]:
    """Return what is stated of parameters at the estimate theta, shape (P,), by their place."""
    if outcome.parameter_set is None or outcome.result is None:
        return {}
    params = constraints.params_at(outcome.result.params, theta)
    bounds = constraints.at_bound(params, outcome.solution.sigma)
    by_symbol = {lmfit_symbol(p.name): p.name for p in outcome.parameters}
    stated = {}
    for i, setting in outcome.parameter_set.settings.items():
        if not setting.is_constraint:
            continue
        expr = setting.expr and _SYMBOL.sub(lambda word: by_symbol.get(word[0], word[0]), setting.expr)
        kind: ConstraintKind = (
            "tied" if expr else "prior" if setting.prior else "bounds" if setting.vary else "fixed"
        )
        bound = None if outcome.undetermined[i] else bounds.get(i)
        stated[i] = Constraint(kind, expr, setting.prior, setting.min, setting.max, bound)
    return stated


def report(
    outcome: IRLSResult,
    experiments: Sequence[Experiment],
    names: Mapping[str, str],
    warnings: Sequence[Finding],
) -> Fit:
    """Report those of the named parameters that are determinable.

    Parameters
    ----------
    outcome : IRLSResult
        Of the fit; chi2 and dof are its own, whatever part of its parameters is named.
    experiments : sequence of Experiment
        What was fitted.
    names : mapping of str to str
        Of the parameters, in the outcome and in the report.
    warnings : sequence of Finding
        To go with it.

    Raises
    ------
    FitError
        If a sigma is no positive number.
    """
    reported = {i: names[name] for name, i in outcome.determined.items() if name in names}
    estimates, covariance = reported_estimates(outcome, reported)
    return Fit(
        parameters=estimates,
        covariance_matrix=covariance,
        chi2=outcome.solution.chi2,
        dof=outcome.solution.dof,
        converged=outcome.converged,
        warnings=tuple(warnings),
        masked_samples=sum(run.n_masked for e in experiments for run in e.runs),
    )
