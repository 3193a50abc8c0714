"""The robustness of a design against other truths and noise."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lpfcosim.campaign import Campaign
from lpfcosim.experiment_design import convex_bound, limits
from lpfcosim.experiment_design.design_problem import build_problem
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.search import Design
from lpfcosim.spacecraft import Noise, Run

N_CORNERS = 6  # corners of the box
GAINS, REST, NOISE_FACTOR = 0.05, 0.3, 2.0  # relative widths; factor
_GAINS = ("lambda_1", "lambda_2")
_REST = ("C_1", "C_2", "omega2_1_0", "omega2_2_0", "alpha_x_1", "alpha_x_2", "alpha_phi_1", "alpha_phi_2")
_LEVELS = ("oms", "thruster", "plateau", "f_x_1_jitter")


@dataclass(frozen=True)
class Robustness:
    """The loss at corners of a box of true values and noise.

    Attributes
    ----------
    loss : float
        Largest growth of the objective over its best at the same corner, relative to that at the centre.
    max_limit_ratio : float
        The most that is reached of a limit.
    draws : int
        How many corners were drawn.
    """

    loss: float
    max_limit_ratio: float
    draws: int


def robustness(design: Design, fit_model: FitModel, on_share: Callable[[float], None]) -> Robustness:
    """Evaluate a design at corners of the box, drawn by the seed of the campaign.

    `on_share` is called with the share of the work that is done.

    Gains are 5 % off, stiffness and delays 30 %, and noise is half or twice as large, each experiment by
    itself.
    """
    generator = np.random.default_rng([design.campaign.seed, N_CORNERS])
    losses, reached = [], []
    for n in range(N_CORNERS):
        on_share(n / N_CORNERS)
        variant = _corner(design.campaign, generator)
        losses.append(_objective_ratio(design, variant, fit_model))
        runs = {run.experiment: run for run in variant.runs if run.kind == "sysid"}
        reached += [
            _max_ratio(runs[experiment.run.experiment], experiment.active_limits)
            for experiment in design.problem.experiments
        ]
    reference = design.value / design.optimum.value
    return Robustness(max(losses) / reference - 1, max(reached), N_CORNERS)


def _objective_ratio(design: Design, variant: Campaign, fit_model: FitModel) -> float:
    """Return the objective at a corner over that of the convex programme there."""
    problem = design.problem
    redesigned = build_problem(variant, problem.sigmas_before, problem.baseline_limits, fit_model)
    forbidden = variant.design.forbidden
    free = replace(problem.objective, max_ratios=np.full(problem.objective.max_ratios.size, np.inf))
    optimum = convex_bound.optimize_power(
        redesigned.experiments, redesigned.prior_information, free, forbidden, rounds=1
    )
    return replace(design, sigmas_after=fit_model.sigmas(variant)).value / optimum.value


def _max_ratio(run: Run, bounds: tuple[limits.Limit, ...]) -> float:
    return max(limits.limit_ratios(run, bounds, limits.tone_response(run)).values())


def _corner(plan: Campaign, generator: np.random.Generator) -> Campaign:
    def off(width: float) -> float:
        return float(1 + width * generator.choice((-1, 1)))

    truth = replace(
        plan.truth,
        **{name: getattr(plan.truth, name) * off(GAINS) for name in _GAINS},
        **{name: getattr(plan.truth, name) * off(REST) for name in _REST},
    )
    experiments = []
    for e in plan.experiments:
        factor = float(NOISE_FACTOR ** generator.choice((-1, 1)))
        experiments.append(
            replace(
                e,
                noise=_scale_noise(e.noise, factor),
                plateau=tuple((when, level * factor) for when, level in e.plateau),
            )
        )
    return replace(plan, truth=truth, experiments=tuple(experiments))


def _scale_noise(noise: Noise, factor: float) -> Noise:
    return replace(noise, **{name: getattr(noise, name) * factor for name in _LEVELS})
