"""The two fits: each experiment by itself (eq. deltaglinear) and all of them jointly (eq. deltagjointfit)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fit.errors import InputError
from fit.estimate.irls import Known, Outcome, reweight
from fit.estimate.runs import Experiment, Run
from fit.estimate.scatter import START, Scatter
from fit.model import Sharing, dynamics
from fit.paper import FLIGHT, Parameter, cross_talk_parameter, experiment_parameters
from fit.settings import Estimator, Settings
from fit.telemetry import Telemetry


def fit_experiment(
    experiment: Experiment, known: Known | None = None, estimator: Estimator = "gaussian"
) -> Outcome:
    """Fit one experiment on its own.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    known : Known, optional
        Of the joint fit, for a run that holds a single tone.
    estimator : str
        See `irls.reweight`.

    Raises
    ------
    FitError
        If no trustworthy estimate comes out.
    """
    run = experiment.sysid.telemetry
    cross_talk = experiment.parameters[len(dynamics.PARAMETERS) :]
    own = experiment_parameters(run.authority, run.alignment_epoch)
    parameters = [*own.values(), *map(cross_talk_parameter, cross_talk)]
    share = np.array([[float(name == p.name) for p in parameters] for name in experiment.parameters])
    return reweight([experiment], [share], parameters, known, estimator=estimator)


def fit_joint(experiments: Sequence[Experiment], chosen: Settings) -> Outcome:
    """Fit all experiments together, what they share as the settings say (eq. deltagjointfit).

    Raises
    ------
    InputError
        If something is to scatter over a single experiment.
    FitError
        If no trustworthy estimate comes out.
    """
    runs = [experiment.sysid.telemetry for experiment in experiments]
    sharing = Sharing(chosen.shared)
    parameters = sharing.parameters([(e.sysid.telemetry, e.parameters) for e in experiments])
    names = [p.name for p in parameters]
    if chosen.scatter and len(runs) < 2:
        raise InputError(f"fit.scatter: {runs[0].experiment} is alone, expected two experiments or more")
    departures, scatter = _departures(chosen.scatter, runs, names)
    shares = []
    for n, e in enumerate(experiments):
        share = sharing.matrix(e.sysid.telemetry, e.parameters, names)
        own = np.zeros((len(share), len(departures)))
        for i, name in enumerate(chosen.scatter):
            own[dynamics.PARAMETERS.index(name), i * len(runs) + n] = 1.0
        shares.append(np.hstack([share, own]))
    return reweight(
        experiments, shares, [*parameters, *departures], estimator=chosen.estimator, scatter=scatter
    )


def _departures(
    scattering: Sequence[str], runs: Sequence[Telemetry], names: Sequence[str]
) -> tuple[list[Parameter], list[Scatter]]:
    """Return the departures of every run from what scatters, and where they stand among the parameters."""
    departures: list[Parameter] = []
    scatter: list[Scatter] = []
    for name in scattering:
        start = START * FLIGHT[name].value
        at = len(names) + len(departures)
        departure = replace(FLIGHT[name], value=0.0, prior_sigma=start, equation="")
        departures += [replace(departure, name=f"d{name}_{run.experiment}") for run in runs]
        scatter.append(Scatter(name, names.index(name), tuple(range(at, at + len(runs))), start))
    return departures, scatter


def known_of(outcome: Outcome, run: Run, sharing: Sharing) -> Known | None:
    """Return what the joint fit says of the parameters of one run; None where it cannot say."""
    names = [p.name for p in outcome.parameters]
    to_run = sharing.matrix(run.telemetry, run.channels.parameters, names)
    if outcome.tone is not None or not to_run.any(axis=1).all():
        return None
    return Known(to_run @ outcome.solution.theta, to_run @ outcome.solution.covariance @ to_run.T)
