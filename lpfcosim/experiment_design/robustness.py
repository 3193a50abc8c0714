"""How a design does where truth and noise are not what it was made for."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lpfcosim.campaign import Campaign
from lpfcosim.experiment_design import limits, programme
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.search import Design
from lpfcosim.experiment_design.sought import changed
from lpfcosim.spacecraft import Noise, Run

DRAWS = 6  # corners of the box
GAINS, REST, LOUDER = 0.05, 0.3, 2.0  # relative widths; factor
_GAINS = ("lambda_1", "lambda_2")
_REST = ("C_1", "C_2", "omega2_1_0", "omega2_2_0", "alpha_x_1", "alpha_x_2", "alpha_phi_1", "alpha_phi_2")
_LEVELS = ("oms", "thruster", "plateau", "f_x_1_jitter")


@dataclass(frozen=True)
class Robustness:
    """What is lost at corners of a box of truths and noise.

    Attributes
    ----------
    loss : float
        Largest growth of the objective over its best at the same corner, beside that at the centre.
    reached : float
        The most that is reached of a limit.
    draws : int
        How many corners were drawn.
    """

    loss: float
    reached: float
    draws: int


def robustness(found: Design, fit_model: FitModel, done: Callable[[float], None]) -> Robustness:
    """Return what is lost at corners of the box, drawn by the seed of the campaign.

    `done` is told the share of the work that is done.

    Gains are 5 % off, stiffness and delays 30 %, and noise is half or twice as large, each experiment by
    itself.
    """
    generator = np.random.default_rng([found.campaign.seed, DRAWS])
    lost, reached = [], []
    for n in range(DRAWS):
        done(n / DRAWS)
        there = _corner(found.campaign, generator)
        lost.append(_excess(found, there, fit_model))
        runs = {run.experiment: run for run in there.runs if run.kind == "sysid"}
        reached += [_reached(runs[stage.run.experiment], stage.bounds) for stage in found.problem.stages]
    here = found.value / found.optimum.value
    return Robustness(max(lost) / here - 1, max(reached), DRAWS)


def _excess(found: Design, there: Campaign, fit_model: FitModel) -> float:
    """Return the objective at a corner over that of the convex programme there."""
    sought = found.problem
    best = changed(there, sought.before, sought.own, fit_model)
    forbidden = there.design.forbidden
    free = replace(sought.objective, most=np.full(sought.objective.most.size, np.inf))
    least = programme.optimum(best.stages, best.fixed, free, forbidden, rounds=1)
    return replace(found, after=fit_model.sigmas(there)).value / least.value


def _reached(run: Run, bounds: tuple[limits.Limit, ...]) -> float:
    return max(limits.excess(run, bounds, limits.driven(run)).values())


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
        louder = float(LOUDER ** generator.choice((-1, 1)))
        experiments.append(
            replace(
                e,
                noise=_louder(e.noise, louder),
                plateau=tuple((when, level * louder) for when, level in e.plateau),
            )
        )
    return replace(plan, truth=truth, experiments=tuple(experiments))


def _louder(noise: Noise, factor: float) -> Noise:
    return replace(noise, **{name: getattr(noise, name) * factor for name in _LEVELS})
