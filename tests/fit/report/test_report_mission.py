"""The report's sections on the experiments together: tables, figures, and the numbers in them."""

from dataclasses import replace

import numpy as np
import pytest

from fit.figures.stiffness import StiffnessPoint, stiffness_pull
from fit.parameters import FLIGHT, joint_names
from fit.report import mission as report_mission
from fit.results import Fit, Results
from fit.results.estimates import Estimate
from fit.results.provenance import Provenance
from tests.oracles.synthetic import AUTHORITIES, World, telemetry

pytestmark = pytest.mark.slow

WORLD = World()


def fit(values, sigmas, warnings=(), **options):
    parameters = {
        n: Estimate(v, s, FLIGHT[n].unit if n in FLIGHT else "s-2")
        for (n, v), s in zip(values.items(), sigmas, strict=True)
    }
    return Fit(parameters, np.diag(np.square(sigmas)), 1.0, 4304, True, tuple(warnings), **options)


def joint(change=None, finer=0.5, **options):
    values = {n: FLIGHT[n].value + (change or {}).get(n, 0.0) * FLIGHT[n].sigma for n in joint_names([1, 2])}
    return fit(values, [finer * FLIGHT[n].sigma for n in values], **options)


def experiment(lambda_2, F, N):
    omega2_2 = -4.19e-7 - 317.0 * F - 27.4e3 * N + 1e-9
    values = {"lambda_2": lambda_2, "omega2_2": omega2_2, "domega2_12": 2e-8, "delta_ifo": -2.2e-5}
    return fit(values, [5e-5, 3e-9, 4e-9, 3e-7])


@pytest.fixture
def mission():
    """Four experiments with telemetry."""
    runs, fits = [], {}
    for k, name in enumerate("ABCD"):
        run = telemetry(WORLD, name, duration=1800.0, noisy=False)
        runs.append(replace(run, t0=f"2016-0{k + 4}-16T00:00:00Z"))
        F, N = 1e-12 * AUTHORITIES[name][1], 1e-12 * AUTHORITIES[name][3]
        fits[name] = experiment(1.0776 + 4e-5 * k, F, N)
    return Results(joint(), fits, {}, {}, Provenance(joint_runs=[run.run for run in runs])), runs


def sections(results, runs):
    return {part.anchor: part for part in report_mission.sections(results, runs)}


@pytest.mark.stat
def test_pulls_of_the_stiffness_model_are_normal():
    # Seven stiffnesses of the same model, fitted by least squares here: 300 campaigns make 2100 pulls, whose
    # standard deviation is known to 1.8 % if they were independent; 6 % is beyond 3 sigma. Seed fixed.
    rng = np.random.default_rng(21)
    F = 1e-12 * np.array([2200.0, 1100.0, 1100.0, 50.0, 2200.0, 2200.0, 5000.0])
    N = 1e-12 * np.array([10.4, 10.4, 1.0, 1.0, 10.4, 1.0, 10.4])
    sigma = 1e-9 * np.array([9.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.7])
    design = np.stack([np.ones(7), F, N], axis=1)
    covariance = np.linalg.inv((design / sigma[:, None] ** 2).T @ design)
    truth = np.array([-4.19e-7, -317.0, -27.4e3])
    names = ("omega2_2_0", "alpha_x_2", "alpha_phi_2")
    pulls, independent_pulls = [], []
    for _ in range(300):
        measured = design @ truth + sigma * rng.standard_normal(7)
        estimate = covariance @ (design.T @ (measured / sigma**2))
        parameters = {n: Estimate(v, 1.0, "") for n, v in zip(names, estimate, strict=True)}
        model = Fit(parameters, covariance, 1.0, 1, True, ())
        points = [
            StiffnessPoint("", 2, f, n, Estimate(m, s, "s-2"))
            for f, n, m, s in zip(F, N, measured, sigma, strict=True)
        ]
        pulls += [stiffness_pull(point, model) for point in points]
        independent = StiffnessPoint(
            "", 2, F[0], N[0], Estimate(design[0] @ truth + 4e-9 * rng.standard_normal(), 4e-9, "s-2"), False
        )
        independent_pulls.append(stiffness_pull(independent, model))
    assert np.std(pulls) == pytest.approx(1, rel=0.06)
    assert np.std(independent_pulls) == pytest.approx(1, rel=0.15)  # 300: 4 %


def test_the_stiffness_of_test_mass_1_is_the_difference(mission):
    results, runs = mission
    points = report_mission.report_stiffness.stiffness_points(results, runs, 1)
    for run in runs:
        point = points[run.experiment]
        of_2 = results.experiments[run.experiment].parameters["omega2_2"].value
        assert (point.F_max, point.N_max) == (run.F_max_1, run.N_max_1)
        assert point.omega2.value == pytest.approx(of_2 - 2e-8)
        assert point.omega2.sigma == pytest.approx(5e-9)  # of 3e-9 and 4e-9, no correlation
