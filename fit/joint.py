"""The two fits: each experiment by itself (eq. deltaglinear) and all of them jointly (eq. deltagjointfit)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fit import dynamics
from fit.irls import Known, Outcome, reweight
from fit.parameters import (
    EXPERIMENT_NAMES,
    cross_talk_parameter,
    experiment_parameter,
    joint_names,
    joint_parameter,
)
from fit.runs import Experiment
from fit.telemetry import Telemetry


def fit_experiment(experiment: Experiment, known: Known | None = None) -> Outcome:
    """Fit one experiment on its own.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    known : Known, optional
        Of the joint fit, for a run that holds a single tone.

    Raises
    ------
    FitError
        If no trustworthy estimate comes out.
    """
    run = experiment.sysid.telemetry
    cross_talk = experiment.parameters[len(dynamics.PARAMETERS) :]
    names = (*EXPERIMENT_NAMES, "lambda_1", "C_1")
    F_max, N_max = (run.F_max_1, run.F_max_2), (run.N_max_1, run.N_max_2)
    parameters = [
        experiment_parameter(name, F_max=F_max, N_max=N_max, epoch=run.alignment_epoch) for name in names
    ] + [cross_talk_parameter(name) for name in cross_talk]
    share = np.array([[float(own == p.name) for p in parameters] for own in experiment.parameters])
    return reweight([experiment], [share], parameters, known)


def fit_joint(experiments: Sequence[Experiment]) -> Outcome:
    """Fit all experiments together: common gains, delays and stiffness model.

    Of delta_ifo and of the coefficients of eq. bump there is one set per alignment epoch.

    Raises
    ------
    FitError
        If no trustworthy estimate comes out.
    """
    runs = [experiment.sysid.telemetry for experiment in experiments]
    parameters = [joint_parameter(name) for name in joint_names(run.alignment_epoch for run in runs)]
    parameters += [cross_talk_parameter(name, epoch) for epoch, name in cross_talk_names(experiments)]
    names = [p.name for p in parameters]
    return reweight(experiments, [share(run, names) for run in runs], parameters)


def cross_talk_names(experiments: Sequence[Experiment]) -> list[tuple[int, str]]:
    """Return the coefficients of eq. bump that the runs can be fitted for: alignment epoch and name."""
    found = {
        (experiment.sysid.telemetry.alignment_epoch, name)
        for experiment in experiments
        for name in experiment.parameters[len(dynamics.PARAMETERS) :]
    }
    return sorted(found)


def share(run: Telemetry, names: Sequence[str]) -> NDArray[np.float64]:
    """Return the map from the P joint parameters to the K of one run, shape (K, P)."""
    epoch = run.alignment_epoch
    omega2_1 = {"omega2_1_0": 1.0, "alpha_x_1": run.F_max_1, "alpha_phi_1": run.N_max_1}  # eq. stiff_model
    omega2_2 = {"omega2_2_0": 1.0, "alpha_x_2": run.F_max_2, "alpha_phi_2": run.N_max_2}
    of_run = {
        "omega2_2": omega2_2,
        "domega2_12": omega2_2 | {name: -factor for name, factor in omega2_1.items()},
        "delta_ifo": {f"delta_ifo_{epoch}": 1.0},
        **{name: {f"{name}_{epoch}": 1.0} for name in dynamics.CROSS_TALK},
    }
    rows = [of_run.get(own, {own: 1.0}) for own in dynamics.run_parameters(dynamics.means(run))]
    return np.array([[row.get(name, 0.0) for name in names] for row in rows])


def known_of(outcome: Outcome, run: Telemetry) -> Known | None:
    """Return what the joint fit says of the parameters of one run; None where it cannot say."""
    to_run = share(run, [p.name for p in outcome.parameters])
    if outcome.tone is not None or not to_run.any(axis=1).all():
        return None
    return Known(to_run @ outcome.solution.theta, to_run @ outcome.solution.covariance @ to_run.T)
