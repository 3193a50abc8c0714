"""Sums that are known though their parts are lost: values and sigmas against what must come out."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from fit.fitting import linear_combination
from fit.forecasting import expected_fit
from fit.parameters import joint_parameter
from fit.settings import settings
from fit.whitening.whitened_run import Solution
from lpfcosim.campaign import loading
from lpfcosim.planned_experiments import planned_experiments
from tests import ROOT

N = 10.4e-12  # N m, the same in all runs


@dataclass(frozen=True)
class StatedExperiment:
    """What `sums` needs of an outcome."""

    parameters: tuple
    solution: Solution

    @property
    def exact(self):
        return np.zeros(len(self.parameters), dtype=bool)


@pytest.fixture
def outcome():
    """Three stiffnesses of one N_max, measured to 1e-9 s-2: background and alpha_phi only as a sum."""
    names = ("omega2_2_0", "alpha_x_2", "alpha_phi_2")
    parameters = tuple(map(joint_parameter, names))
    F = np.array([0.0, 1e-9, 2e-9])
    design = np.stack([np.ones(3), F, np.full(3, N)], axis=1) / 1e-9
    scale = np.array([p.prior_sigma for p in parameters])
    information = np.diag(np.ones(3)) + (design * scale).T @ (design * scale)
    covariance = np.linalg.inv(information) * np.outer(scale, scale)
    theta = np.array([p.value for p in parameters])
    return StatedExperiment(parameters, Solution(theta, covariance, 3.0, 3))


def test_a_sum_has_the_sigma_of_a_straight_line(outcome):
    # two parameters, intercept and slope, through three points of 1e-9 each
    for F, share in ((0.0, 5 / 6), (1e-9, 1 / 3), (2e-9, 5 / 6)):
        value, sigma = linear_combination(outcome, {"omega2_2_0": 1.0, "alpha_x_2": F, "alpha_phi_2": N})
        assert value == pytest.approx(-4.19e-7 - 317.0 * F - 27.4e3 * N)
        assert sigma == pytest.approx(1e-9 * np.sqrt(share), rel=1e-3)


def test_weak_priors_are_no_knowledge(outcome):
    assert linear_combination(outcome, {"omega2_2_0": 1.0}) is None
    assert linear_combination(outcome, {"omega2_2_0": 1.0, "alpha_x_2": 0.0, "alpha_phi_2": 1e-12}) is None
    assert linear_combination(outcome, {"omega2_1_0": 1.0}) is None


def test_a_sweep_of_one_authority_knows_the_stiffness_at_each():
    plan = loading.load(ROOT / "campaigns" / "sweep.toml")
    plan = replace(plan, experiments=plan.experiments[::3])
    joint = expected_fit.expected_fit(planned_experiments(plan), settings())
    assert {"omega2_2_0", "alpha_phi_2", "omega2_1_0", "alpha_phi_1"} <= set(joint.undetermined)
    truth = plan.truth
    stiffness = {(s.j, s.F_max): s for s in joint.stiffness}
    assert list(stiffness) == [
        (1, 0.0),
        *((2, plan.authority[e.authority].F_max_2) for e in plan.experiments),
    ]
    for (j, F), known in stiffness.items():
        names = f"omega2_{j}_0", f"alpha_x_{j}", f"alpha_phi_{j}"
        background, per_force, per_torque = (truth[name] for name in names)
        assert known.value == pytest.approx(background + per_force * F + per_torque * N, rel=0.01)
        assert 1e-9 < known.sigma < 2e-8
    (message,) = (w.message for w in joint.warnings if "alpha_phi_2" in w.parameters)
    assert "only omega2_2_0 + 1.04e-11 alpha_phi_2 = -7.0" in message
