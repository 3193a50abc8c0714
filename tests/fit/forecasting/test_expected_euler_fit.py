"""The forecast of the inertial angles: against fits through FMUs, without FMUs, and drawn."""

from dataclasses import replace

import numpy as np
import pytest

from fit.crosstalk.euler_fit import fit_period
from fit.errors import InputError
from fit.forecasting.expected_euler_fit import expected_periods
from fit.settings import settings
from lpfcosim.campaign import loading
from lpfcosim.linear import spectral_simulation
from lpfcosim.planned_experiments import planned_noise_runs, telemetry_of
from lpfcosim.workflows.montecarlo_trial import SpectralSimulator
from tests import ROOT
from tests.oracles.rotation_synthetic import calibration

INERTIAL = ROOT / "campaigns" / "inertial.toml"
CHANNEL_NAMES = [
    f"{k}_{j}" for axis in ("phi", "eta") for k in (f"N_{axis}", f"o_{axis}") for j in (1, 2, 12)
]
READ = [name for name in CHANNEL_NAMES if name[0] + name[-2:] not in ("N12", "o_2")]
CHANNELS = ["o_1", "o_12", "f_x_1", "f_x_2", *READ, "ast_phi", "ast_eta"]


@pytest.fixture(scope="module")
def plan():
    return loading.load(INERTIAL)


def expected_fits(*runs):
    return expected_periods(planned_noise_runs(runs), calibration().joint)


def sigmas(fit):
    return {name: estimate.sigma for name, estimate in fit.parameters.items()}


def test_sigmas_are_those_of_the_campaign_through_fmus(plan):
    periods = expected_fits(*plan.runs)  # six-hour noise runs take no part
    assert list(periods) == ["1", "2", "3"]
    # measured with `lpfcosim run campaigns/inertial.toml`, see docs/benchmarks.md
    measured = {"1": (0.020e-3, 0.0042e-3), "2": (0.012e-3, 0.0027e-3), "3": (0.006e-3, 0.0013e-3)}
    for period, fit in periods.items():
        assert tuple(sigmas(fit).values()) == pytest.approx(measured[period], rel=0.1)
        drawn = plan.runs[[run.inertial_period for run in plan.runs].index(int(period))].truth
        truth = {name: drawn[name] for name in ("delta_phi", "delta_eta")}
        for name, estimate in fit.parameters.items():
            assert abs(estimate.value - truth[name]) < 0.2 * estimate.sigma


@pytest.mark.slow
def test_loud_torques_widen_as_they_do_in_fits(plan):
    run = next(run for run in plan.runs if run.experiment == "P3a")
    noisy = replace(run, noise={**run.noise, "torque": 8e-12})
    drawn, joint = spectral_simulation.Simulation(noisy, CHANNELS), calibration().joint
    fits = [
        fit_period([telemetry_of(noisy, drawn.record(np.random.default_rng(i)))], joint) for i in range(4)
    ]
    nominal, expected = sigmas(expected_fits(run)["3"]), sigmas(expected_fits(noisy)["3"])
    for name, sigma in expected.items():
        assert sigma == pytest.approx(np.mean([sigmas(fit)[name] for fit in fits]), rel=0.08)
        assert sigma > 1.02 * nominal[name]


@pytest.mark.slow
def test_monte_carlo_fits_have_these_sigmas(plan):
    run, joint = next(run for run in plan.runs if run.experiment == "P3a"), calibration().joint
    simulator = SpectralSimulator()
    fits = [fit_period([simulator.draw(run, np.random.default_rng(i))], joint) for i in range(3)]
    for name, sigma in sigmas(expected_fits(run)["3"]).items():
        assert sigma == pytest.approx(np.mean([sigmas(fit)[name] for fit in fits]), rel=0.08)
    for fit in fits:  # the steady turn is there too
        assert fit.centrifugal.value == pytest.approx(1, abs=4.5 * fit.centrifugal.sigma)
        assert fit.centrifugal.sigma < 0.1


def test_angles_obey_the_settings(plan):
    run = next(run for run in plan.runs if run.experiment == "P3a")
    noise_runs, joint = planned_noise_runs([run]), calibration().joint
    unconstrained = expected_periods(noise_runs, joint)["3"]
    value, sigma = unconstrained["delta_phi"].value, unconstrained["delta_phi"].sigma
    fixed = settings({"parameters": {"delta_phi_3": {"vary": False, "value": value}}})
    constrained = expected_periods(noise_runs, joint, fixed.parameters)["3"]
    assert constrained["delta_phi"].is_exact
    assert constrained["delta_eta"].sigma < unconstrained["delta_eta"].sigma
    prior = settings({"parameters": {"delta_phi_3": {"prior": [value, sigma]}}})
    known = expected_periods(noise_runs, joint, prior.parameters)["3"]
    assert known["delta_phi"].sigma == pytest.approx(sigma / 2**0.5, rel=0.05)
    unknown = settings({"parameters": {"delta_phi_7": {"vary": False}}})
    with pytest.raises(InputError, match="delta_phi_7: no parameter of this fit"):
        expected_periods(noise_runs, joint, unknown.parameters)


def test_drowned_in_torque_noise_as_the_fit_is(plan):
    run = next(run for run in plan.runs if run.experiment == "P1")
    (fit,) = expected_fits(replace(run, noise={**run.noise, "torque": 5e-10})).values()
    assert "torque_noise" in {w.code for w in fit.warnings}
