"""The two fits: each experiment by itself (Eq. (5)) and all of them jointly (Eq. (11))."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.findings import Finding
from fit.fitting import constraints, random_effects
from fit.fitting.irls import IRLSResult, reweight
from fit.fitting.width_posterior import marginalise_widths
from fit.model import Sharing, dynamics
from fit.parameters import Parameter, stiffness_terms
from fit.results import Fit, Stiffness
from fit.settings import Estimator, ParameterSettings, Settings
from fit.telemetry import Telemetry
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]

KNOWN = 0.1  # sigma of a determined combination over the width of its weak prior, which is then 1 % of it
OF_EPOCH = ("delta_ifo", *dynamics.CROSS_TALK)  # parameters whose names in the joint fit end with the epoch


def fit_experiment(
    experiment: Experiment,
    estimator: Estimator = "gaussian",
    initial_fit: IRLSResult | FitError | None = None,
    settings: Mapping[str, ParameterSettings] | None = None,
) -> IRLSResult:
    """Fit one experiment on its own.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    estimator : str
        See `irls.reweight`.
    initial_fit : IRLSResult or FitError, optional
        What it yields otherwise, as for `fit_joint`.
    settings : mapping of str to ParameterSettings, optional
        Constraints of joint parameters; they hold for those that an experiment has by itself.

    Raises
    ------
    FitError
        If no valid estimate results.
    """
    run = experiment.sysid
    parameters = run.spacecraft.parameters(run.telemetry, experiment.parameters)
    share = np.array([[float(name == p.name) for p in parameters] for name in experiment.parameters])
    initial = _weighed({experiment.name: initial_fit})
    params = constraints.params(parameters, settings, names_of(experiment))
    return reweight([experiment], [share], parameters, estimator=estimator, initial=initial, params=params)


def names_of(experiment: Experiment) -> dict[str, str]:
    """Return by the names in a joint fit those of the parameters of an experiment by itself."""
    epoch = experiment.sysid.telemetry.alignment_epoch
    return {f"{name}_{epoch}" if name in OF_EPOCH else name: name for name in experiment.parameters}


def fit_joint(
    experiments: Sequence[Experiment],
    settings: Settings,
    single_fits: Mapping[str, IRLSResult | FitError] | None = None,
) -> IRLSResult:
    """Fit all experiments together, what they share as settings state (Eq. (11)).

    Parameters
    ----------
    experiments : sequence of Experiment
        To be fitted.
    settings : Settings
        With ``scatter = "auto"`` nothing scatters here, see `fit.agreement`.
    single_fits : mapping of str to IRLSResult or FitError, optional
        What experiments yield by themselves: the iteration begins with them as they were weighed there.

    Raises
    ------
    InputError
        If something is to scatter over a single experiment.
    FitError
        If no valid estimate results.
    """
    scattering = [] if settings.scatter == ["auto"] else settings.scatter
    if scattering and len(experiments) < 2:
        raise InputError(f"fit.scatter: {experiments[0].name} is the only experiment, expected two or more")
    parameters, maps, widths = joint_parameters(experiments, settings, scattering)
    outcome = reweight(
        experiments,
        maps,
        parameters,
        estimator=settings.estimator,
        random_effects=widths,
        initial=_weighed(single_fits or {}),
        params=constraints.params(parameters, settings.parameters),
    )
    return marginalise_widths(outcome) if widths else outcome


def _weighed(fits: Mapping[str, IRLSResult | FitError | None]) -> dict[str, whitened_run.WhitenedRun]:
    return {name: fit.whitened_runs[0] for name, fit in fits.items() if isinstance(fit, IRLSResult)}


def joint_parameters(
    experiments: Sequence[Experiment], settings: Settings, scattering: Sequence[str] = ()
) -> tuple[list[Parameter], list[Array], list[random_effects.ScaleParameter]]:
    """Return the parameters of a joint fit, and how those of each experiment follow from them.

    Parameters
    ----------
    experiments : sequence of Experiment
        To be fitted together.
    settings : Settings
        They state what the experiments share.
    scattering : sequence of str
        Parameters that depart from experiment to experiment.

    Returns
    -------
    parameters : list of Parameter
        The P parameters: the shared ones, then departures.
    maps : list of ndarray, shape (K, P)
        For each experiment, see `WhitenedRun`.
    widths : list of ScaleParameter
        Of the departures.
    """
    sharing = Sharing(settings.shared)
    for e, name in ((e, name) for e in experiments for name in scattering):
        if name not in e.parameters:
            raise InputError(f"fit.scatter: {name}: no parameter of {e.name}, expected one")
    shared = sharing.parameters([(e.sysid.telemetry, e.parameters) for e in experiments])
    names = [p.name for p in shared]
    deviations, widths = random_effects.parameters(scattering, [e.name for e in experiments], len(names))
    maps = []
    for n, e in enumerate(experiments):
        of_deviations = random_effects.deviation_map(e.parameters, scattering, n, len(experiments))
        maps.append(np.hstack([sharing.matrix(e.sysid.telemetry, e.parameters, names), of_deviations]))
    return [*shared, *deviations], maps, widths


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
    estimates, covariance = outcome.estimates(reported)
    return Fit(
        parameters=estimates,
        covariance_matrix=covariance,
        chi2=outcome.solution.chi2,
        dof=outcome.solution.dof,
        converged=outcome.converged,
        warnings=tuple(warnings),
        masked_samples=sum(run.n_masked for e in experiments for run in e.runs),
    )


def linear_combination(outcome: IRLSResult, factors: Mapping[str, float]) -> tuple[float, float] | None:
    """Return a sum of parameters of a fit, ``factors`` times each, and its sigma; None if undetermined.

    Weak priors constrain what the data do not, so that the covariance is that of all parameters. A sum of
    exact values only is not determined by the data.
    """
    names = [p.name for p in outcome.parameters]
    if not factors.keys() <= set(names):
        return None
    row = np.array([factors.get(name, 0.0) for name in names])
    if not np.any(row[~outcome.exact]):
        return None
    prior = math.sqrt(sum((f * p.prior_sigma) ** 2 for f, p in zip(row, outcome.parameters, strict=True)))
    solution = outcome.solution
    sigma = math.sqrt(max(float(row @ solution.covariance @ row), 0.0))
    return (float(row @ solution.theta), sigma) if 0 < sigma < KNOWN * prior else None


def stiffnesses(outcome: IRLSResult, runs: Sequence[Telemetry]) -> tuple[Stiffness, ...]:
    """Return what a joint fit says of omega2_j at the authorities of its runs (Eq. (8))."""
    settings = dict.fromkeys((j, *run.authority[j - 1]) for j in (1, 2) for run in runs)
    combinations = [(setting, linear_combination(outcome, stiffness_terms(*setting))) for setting in settings]
    return tuple(Stiffness(*setting, *combination) for setting, combination in combinations if combination)
