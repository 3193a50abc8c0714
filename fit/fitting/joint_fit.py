"""The two fits: each experiment by itself (eq. deltaglinear) and all of them jointly (eq. deltagjointfit)."""

from collections.abc import Mapping, Sequence

import numpy as np

from fit.errors import FitError, InputError
from fit.fitting import constraints, departures
from fit.fitting.irls import IRLSResult, reweight
from fit.model import Sharing, dynamics
from fit.parameters import cross_talk_parameter, experiment_parameters
from fit.settings import Estimator, ParameterSettings, Settings
from fit.whitening import Experiment, whitened_run

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
        If no trustworthy estimate comes out.
    """
    run = experiment.sysid.telemetry
    cross_talk = experiment.parameters[len(dynamics.PARAMETERS) :]
    flight = experiment_parameters(run.authority, run.alignment_epoch)
    parameters = [*flight.values(), *map(cross_talk_parameter, cross_talk)]
    share = np.array([[float(name == p.name) for p in parameters] for name in experiment.parameters])
    initial = _weighed({experiment.name: initial_fit})
    of_run = constraints_of(experiment, settings or {})
    return reweight([experiment], [share], parameters, estimator=estimator, initial=initial, settings=of_run)


def constraints_of(
    experiment: Experiment, settings: Mapping[str, ParameterSettings]
) -> dict[str, ParameterSettings]:
    """Return the constraints of joint parameters that an experiment has by itself, by its own names."""
    epoch, run_names = experiment.sysid.telemetry.alignment_epoch, experiment.parameters
    names = {f"{name}_{epoch}" if name in OF_EPOCH else name: name for name in run_names}
    return constraints.of_fit(settings, names)


def fit_joint(
    experiments: Sequence[Experiment],
    settings: Settings,
    single_fits: Mapping[str, IRLSResult | FitError] | None = None,
) -> IRLSResult:
    """Fit all experiments together, what they share as the settings say (eq. deltagjointfit).

    Parameters
    ----------
    experiments : sequence of Experiment
        To be fitted.
    settings : Settings
        With ``scatter = "auto"`` nothing scatters here, see `fit.consistency`.
    single_fits : mapping of str to IRLSResult or FitError, optional
        What experiments yield by themselves: the iteration begins with them as they were weighed there.

    Raises
    ------
    InputError
        If something is to scatter over a single experiment.
    FitError
        If no trustworthy estimate comes out.
    """
    initial = _weighed(single_fits or {})
    if settings.scatter == ["auto"]:
        return _fitted(experiments, settings, (), initial)
    if settings.scatter and len(experiments) < 2:
        raise InputError(f"fit.scatter: {experiments[0].name} is alone, expected two experiments or more")
    return _fitted(experiments, settings, settings.scatter, initial)


def _weighed(fits: Mapping[str, IRLSResult | FitError | None]) -> dict[str, whitened_run.WhitenedRun]:
    return {name: fit.whitened_runs[0] for name, fit in fits.items() if isinstance(fit, IRLSResult)}


def _fitted(
    experiments: Sequence[Experiment],
    settings: Settings,
    scattering: Sequence[str],
    initial: Mapping[str, whitened_run.WhitenedRun],
) -> IRLSResult:
    """Fit all experiments together, with departures from what is named."""
    sharing, N = Sharing(settings.shared), len(experiments)
    parameters = sharing.parameters([(e.sysid.telemetry, e.parameters) for e in experiments])
    names = [p.name for p in parameters]
    deviations, widths = departures.parameters(scattering, [e.name for e in experiments], len(names))
    shares = [
        departures.extend_map(sharing.matrix(e.sysid.telemetry, e.parameters, names), scattering, n, N)
        for n, e in enumerate(experiments)
    ]
    outcome = reweight(
        experiments,
        shares,
        [*parameters, *deviations],
        estimator=settings.estimator,
        random_effects=widths,
        initial=initial,
        settings=constraints.of_fit(settings.parameters, dict(zip(names, names, strict=True))),
    )
    return departures.marginalise_widths(outcome) if widths else outcome
