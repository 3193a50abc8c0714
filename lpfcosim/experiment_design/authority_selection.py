"""Settings of the actuation as part of a design: which authority each experiment had best.

The stiffness depends on them, so that they decide how well an experiment determines its parts. Of each
experiment one setting after the other is tried with the power that the convex programme has found, until none
determines more. Then the programme is solved anew.
"""

from dataclasses import fields, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import convex_bound
from lpfcosim.experiment_design.convex_bound import Optimum
from lpfcosim.experiment_design.design_problem import DesignProblem, build_problem
from lpfcosim.experiment_design.designed_experiment import DesignedExperiment
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.search import SearchProgress
from lpfcosim.spacecraft import Authority

Array = NDArray[np.float64]

MAX_ROUNDS = 4  # times that the programme is solved anew, at most
MAX_CONDITION = 1e13  # condition of information from which on settings leave some parameter untold
MIN_IMPROVEMENT = 1e-3  # relative, by which the objective must fall for another one


def select_authority(problem: DesignProblem, fit_model: FitModel, progress: SearchProgress) -> DesignProblem:
    """Return the problem with the allowed authority of each experiment that improves the objective most.

    Raises
    ------
    InputError
        If no setting is possible.
    """
    candidates = _uniform_variants(problem, fit_model)
    if not candidates:
        raise InputError("design.authority: with none of these settings can the campaign be flown")
    optimum = _optimize_power(problem, progress)
    for _ in range(MAX_ROUNDS):
        settings = _exchange_authority(problem, optimum, [problem, *candidates])
        if not settings:
            break
        variant = build_problem(
            _with_authority(problem.plan, settings), problem.sigmas_before, problem.baseline_limits, fit_model
        )
        variant_optimum = _optimize_power(variant, progress)
        if variant_optimum.value > optimum.value * (1 - MIN_IMPROVEMENT):
            break
        problem, optimum = variant, variant_optimum
    return problem


def _optimize_power(problem: DesignProblem, progress: SearchProgress) -> Optimum:
    forbidden = problem.plan.design.forbidden
    return convex_bound.optimize_power(
        problem.experiments,
        problem.prior_information,
        problem.objective,
        forbidden,
        progress.on_bound,
        rounds=1,
    )


def _uniform_variants(problem: DesignProblem, fit_model: FitModel) -> list[DesignProblem]:
    """Return variants of the campaign, each with one allowed authority for all experiments."""
    allowed = problem.plan.design.authority
    variants = []
    for values in product(*allowed.values()):
        authority: dict[str, Any] = dict(zip(allowed, values, strict=True))
        settings = {e.name: replace(e.authority, **authority) for e in problem.plan.experiments}
        try:
            variants.append(
                build_problem(
                    _with_authority(problem.plan, settings),
                    problem.sigmas_before,
                    problem.baseline_limits,
                    fit_model,
                )
            )
        except InputError:  # what is held without any tone is more than this allows, or the loop is unstable
            continue
    return variants


def _exchange_authority(
    problem: DesignProblem, optimum: Optimum, candidates: list[DesignProblem]
) -> dict[str, Authority]:
    """Return the better authority of each experiment, by its name; empty if none improves the objective."""
    objective = problem.objective
    options = []
    for n, experiment in enumerate(problem.experiments):
        variants = [
            variant
            for c in candidates
            for variant in c.experiments
            if variant.run.experiment == experiment.run.experiment
        ]
        information = [_information_at(variant, experiment, optimum, n) for variant in variants]
        options.append(list(zip(variants, information, strict=True)))
    choice = [0] * len(options)

    def value(choice: list[int]) -> float:
        information = problem.prior_information + sum(
            option[k][1] for option, k in zip(options, choice, strict=True)
        )
        if np.linalg.cond(information) > MAX_CONDITION:
            return np.inf
        return objective.slope(objective.logs(information))[0]

    minimum, improved = value(choice), True
    while improved:
        improved = False
        for n, option in enumerate(options):
            trials = [value([*choice[:n], k, *choice[n + 1 :]]) for k in range(len(option))]
            k = int(np.argmin(trials))
            if trials[k] < minimum - 1e-9:
                choice[n], minimum, improved = k, trials[k], True
    if not any(choice):
        return {}
    runs = [option[k][0].run for option, k in zip(options, choice, strict=True)]
    return {run.experiment: run.authority for run in runs}


def _information_at(
    variant: DesignedExperiment, experiment: DesignedExperiment, optimum: Optimum, n: int
) -> Array:
    """Return the information of an experiment at another authority, its power scaled to the limits."""
    sensitivity, cost = variant.responses(optimum.frequencies[n])
    power = np.zeros((len(sensitivity), len(variant.loops), len(variant.loops)), dtype=np.complex128)
    shared = [loop for loop in experiment.loops if loop in variant.loops]
    to, of = ([loops.index(loop) for loop in shared] for loops in (variant.loops, experiment.loops))
    power[:, np.array(to)[:, None], to] = optimum.powers[n][:, np.array(of)[:, None], of]
    reached = np.einsum("nyi,nij,nyj->y", cost, power, cost.conj()).real
    tones = (
        np.einsum("npi,nij,nqj->pq", sensitivity, power, sensitivity.conj()).real * 2 * variant.model.duration
    )
    return np.asarray(variant.base_information + tones / max(float(reached.max()), 1.0))


def _with_authority(plan: Campaign, settings: dict[str, Authority]) -> Campaign:
    """Return a campaign with other authority sets, new ones named by their values."""
    experiments = tuple(
        replace(e, authority=_named_authority(settings[e.name], plan)) if e.name in settings else e
        for e in plan.experiments
    )
    return replace(plan, experiments=experiments)


def _named_authority(authority: Authority, plan: Campaign) -> Authority:
    numbers = [field.name for field in fields(Authority) if field.name != "name"]
    values = [getattr(authority, name) for name in numbers]
    for e in plan.experiments:
        if values == [getattr(e.authority, name) for name in numbers]:
            return e.authority
    parts = (f"{value * 1e12:.4g}".replace(".", "p") for value in values)
    return replace(authority, name="F{}-{}-N{}-{}".format(*parts))
