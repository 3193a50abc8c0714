"""What differs from experiment to experiment more than noise makes it.

A gain or a delay departs from its common value: in every experiment by an unknown amount, drawn from a
Gaussian about zero. Its width is not known either. The two test masses share it, relative to the flight
values: their actuators are alike. So a gain that a single experiment determines gets the sigma that the
scatter of the other implies.

A gain that departs leaves the force as late as it was: C = lambda tau departs along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.fitting import hierarchy, normal
from fit.fitting.hierarchy import ScaleParameter
from fit.fitting.irls import IRLSResult
from fit.fitting.joint_model import Prior
from fit.fitting.problem import FREE
from fit.model import dynamics
from fit.parameters import FLIGHT, Parameter
from fit.whitening import whitened_run

if TYPE_CHECKING:
    from lmfit.minimizer import MinimizerResult

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RandomEffect:
    """One way to depart.

    Attributes
    ----------
    name : str
        In words.
    parameters : tuple of str
        What departs, for test masses 1 and 2.
    units : tuple of str
        The parameters whose flight values the width is relative to.
    scale : float
        Of the half-Cauchy prior of the width.
    """

    name: str
    parameters: tuple[str, str]
    units: tuple[str, str]
    scale: float


GAINS = ("lambda_1", "lambda_2")
DELAYS = {"lambda_1": "C_1", "lambda_2": "C_2"}  # C = lambda tau, by its gain
#: The scales are a choice: in flight lambda_2 scattered by 0.005, and C had sigmas of 0.02.
RANDOM_EFFECTS = (
    RandomEffect("gain", GAINS, GAINS, 0.005),
    RandomEffect("delay", ("C_1", "C_2"), ("C_1", "C_2"), 0.02),
)


def parameters(
    names: Sequence[str], experiments: Sequence[str], start: int
) -> tuple[list[Parameter], list[ScaleParameter]]:
    """Return the departures of every experiment from what is named, and the widths that they share.

    Parameters
    ----------
    names, experiments : sequence of str
        What departs, and where.
    start : int
        Where the first of the departures stands among the parameters of the fit.
    """
    deviations: list[Parameter] = []
    widths: list[ScaleParameter] = []
    for kind in RANDOM_EFFECTS:
        members: list[int] = []
        units: list[float] = []
        for name, unit in zip(kind.parameters, kind.units, strict=True):
            if name not in names:
                continue
            flight = FLIGHT[unit]
            free = 2 * FREE * kind.scale * flight.value  # wider than what holds it: never indeterminable
            departure = replace(flight, value=0.0, prior_sigma=free, equation="")
            members += range(start + len(deviations), start + len(deviations) + len(experiments))
            units += [flight.value] * len(experiments)
            deviations += [replace(departure, name=f"d{name}_{experiment}") for experiment in experiments]
        if members:
            widths.append(ScaleParameter(kind.name, tuple(members), np.array(units), kind.scale))
    return deviations, widths


def extend_map(parameter_map: Array, names: Sequence[str], experiment: int, experiments: int) -> Array:
    """Return the map to the parameters of a run, shape (K, P), with the departures of `parameters` beside.

    Parameters
    ----------
    root_level : ndarray, shape (K, P)
        Without.
    names : sequence of str
        What departs.
    experiment, experiments : int
        Number of the run, and how many there are.
    """
    n_cross_talk = len(parameter_map) - len(dynamics.PARAMETERS)  # of cross-talk, which does not depart
    deviations = deviation_map((*dynamics.PARAMETERS, *[""] * n_cross_talk), names, experiment, experiments)
    return np.hstack([parameter_map, deviations])


def deviation_map(
    of_run: Sequence[str],
    names: Sequence[str],
    experiment: int,
    experiments: int,
    delays: Sequence[str] = tuple(DELAYS.values()),
) -> Array:
    """Return the map from the D departures of all experiments to the K parameters of a run, shape (K, D).

    Parameters
    ----------
    run_gradient : sequence of str
        The parameters of the run, `names` among them.
    names : sequence of str
        What departs.
    experiment, experiments : int
        Number of the run, and how many there are.
    delays : sequence of str
        The parameters C that are to be told that their gain departs.
    """
    ordered = [name for kind in RANDOM_EFFECTS for name in kind.parameters if name in names]
    columns = np.zeros((len(of_run), len(ordered) * experiments))
    for i, name in enumerate(ordered):
        column = i * experiments + experiment
        columns[of_run.index(name), column] = 1.0
        delay = DELAYS.get(name, "")
        if delay in delays:
            columns[of_run.index(delay), column] = FLIGHT[delay].value / FLIGHT[name].value
    return columns


def marginalise_widths(outcome: IRLSResult) -> IRLSResult:
    """Return the outcome of a fit with departures, their widths integrated over.

    Raises
    ------
    FitError
        If the data leave a direction free.
    """
    theta, whitened_runs = outcome.solution.theta, outcome.whitened_runs
    variance_factors = normal.variance_factors(whitened_runs, theta)
    members = [i for width in outcome.random_effects for i in width.members]
    joined = normal.recentre(
        normal.joint_normal_equations(whitened_runs, outcome.prior, theta, variance_factors), members
    )
    posterior = hierarchy.marginalise(joined, outcome.random_effects)
    _, _, covariance = hierarchy.conditional(joined, outcome.random_effects, posterior.log_widths)
    determined = round(float(np.trace(covariance @ joined.H)))
    residuals = [block.root_level @ block.coefficients(posterior.mean) for block in whitened_runs]
    solution = whitened_run.Solution(
        posterior.mean,
        posterior.covariance,
        float(np.sum(np.concatenate(residuals) ** 2)),
        sum(block.size for block in whitened_runs) - determined,
    )
    scatter = {}
    for width, value, sigma in zip(outcome.random_effects, posterior.widths, posterior.sigmas, strict=True):
        for unit, name in dict(zip(width.units, _names(outcome, width), strict=True)).items():
            scatter[name] = (float(value * unit), float(sigma * unit))
    log_widths = tuple(zip(posterior.log_widths.tolist(), posterior.log_sigmas.tolist(), strict=True))
    outcome = replace(outcome, solution=solution, scatter=scatter, log_widths=log_widths)
    return replace(outcome, result=_within_widths(outcome))


def _within_widths(outcome: IRLSResult) -> MinimizerResult | None:
    """Return what lmfit makes of the runs with departures within their likeliest widths."""
    if outcome.model is None or outcome.result is None:
        return None
    params = outcome.result.params.copy()
    ordered = list(params.values())
    for width, (log_width, _) in zip(outcome.random_effects, outcome.log_widths, strict=True):
        sigmas = np.exp(log_width) * np.abs(width.units)
        for i, sigma in zip(width.members, sigmas.tolist(), strict=True):
            ordered[i].user_data = Prior(0.0, sigma)
    return outcome.model.fit(params)


def _names(outcome: IRLSResult, width: ScaleParameter) -> list[str]:
    """Return what each of the departures of a width departs from."""
    kind = next(kind for kind in RANDOM_EFFECTS if kind.name == width.name)
    names = [outcome.parameters[i].name for i in width.members]
    return [next(p for p in kind.parameters if name.startswith(f"d{p}_")) for name in names]
