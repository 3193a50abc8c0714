"""Weights, true sigmas, blind directions and single experiments, on telemetry of known noise."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from fit import whitening
from fit.fitting import fit_experiment, irls, weighings
from fit.fitting.joint_model import JointModel
from fit.fitting.null_space import null_space
from fit.fitting.run_estimate import run_estimate
from fit.pipeline import calibrate
from fit.settings import settings
from fit.spectra import windowing
from fit.spectra.noise_psd import NoiseModel
from fit.whitening import weights, whitened_run
from lpfcosim.campaign import loading
from lpfcosim.campaign.montecarlo import numbered
from lpfcosim.workflows.montecarlo_trial import SpectralSimulator
from tests import ROOT
from tests.fit.fitting.linear_equation import params_of
from tests.oracles import thirteen
from tests.oracles.closed_loop import Drive
from tests.oracles.synthetic import World, of_run, pair, without

NAMES = ["lambda_2", "C_2", "omega2_2", "domega2_12", "delta_ifo"]


def fit_one(runs):
    (fit,) = calibrate(runs, settings({"include_short": True})).experiments.values()
    return fit


def pulls(fit, truth):
    return {name: (e.value - truth[name]) / e.sigma for name, e in fit.parameters.items()}


def flat(level):
    """Make a noise model of the constant PSD `level`, known perfectly."""
    knots = np.log([1e-5, 1e-2, 1.0])
    return NoiseModel(knots, np.full(3, np.log(level)), np.zeros((3, 3)))


@pytest.mark.parametrize(("taper", "ratio"), [(0.0, 1.0), (0.1, 1.027), (1.0, 1.39)])
def test_sigma_accounts_for_the_window(taper, ratio, changed):
    # White noise of unit variance (PSD 2 at 1 Hz), stationary columns: var = <w^4>/<w^2>^2 x naive.
    changed(windowing, "TAPER", taper)
    changed(windowing, "window", partial(windowing.window, taper=taper))
    columns = np.random.default_rng(3).standard_normal((20000, 8))
    run = windowing.transform(columns, np.ones(20000, bool), 1.0, (0.1, 0.1))
    block = whitened_run.whiten_run(run, flat(2.0), np.eye(7))
    naive = np.linalg.inv(block.R.T @ block.R)
    true = naive @ block.M @ naive
    measured = np.sqrt(np.diag(true) / np.diag(naive)).mean()
    assert measured == pytest.approx(ratio, rel=0.01)


def test_constant_and_ramp_are_invisible():
    n = 4000
    columns = np.random.default_rng(5).standard_normal((n, 8))
    drift = columns + np.linspace(3, 70, n)[:, None]
    blocks = [
        whitened_run.whiten_run(
            windowing.transform(x, np.ones(n, bool), 1.0, (0.1, 0.1)), flat(2.0), np.eye(7)
        )
        for x in (columns, drift)
    ]
    assert np.allclose(blocks[0].R.T @ blocks[0].R, blocks[1].R.T @ blocks[1].R, atol=1e-6)
    assert np.allclose(blocks[0].M, blocks[1].M, atol=1e-6)


@given(
    ratio=st.floats(0.2, 5),
    noise=st.sampled_from([0.0, 1e-12, 1e-9]),
    strength=st.floats(10, 1e5),
)
def test_collinear_columns_are_named_together(ratio, noise, strength):
    rng = np.random.default_rng(6)
    a, b = rng.standard_normal((2, 50))
    A = strength * np.stack([a, ratio * a + noise * b, b], axis=1)
    undetermined, directions = null_space(A.T @ A, np.ones(3))
    assert undetermined.tolist() == [True, True, False]
    (direction,) = directions
    assert np.abs(A @ direction).max() < 1e-6 * strength
    assert np.max(direction) == 1


@given(arrays(float, (12, 4), elements=st.floats(-1, 1).map(lambda x: round(x, 3))))
def test_blind_directions_are_what_the_data_do_not_see(A):
    A = 1e3 * A
    undetermined, directions = null_space(A.T @ A, np.ones(4))
    assert not undetermined.any() or len(directions)
    for direction in directions:
        assert np.sum((A @ direction) ** 2) < 4 * np.sum(direction**2) + 1e-3


def test_psd_error_is_the_change_of_the_scores_with_the_knots():
    rng, f = np.random.default_rng(6), np.arange(1, 400) / 800
    U = rng.standard_normal((f.size, 4)) + 1j * rng.standard_normal((f.size, 4))
    U[:, 1] += U[:, 0]  # as commands that respond to the noise
    root = rng.standard_normal((3, 3))
    noise = NoiseModel(np.log([1e-3, 1e-2, 1e-1]), np.zeros(3), root @ root.T)
    even = weights("gaussian", f, np.full(f.size, 2.0))
    run = whitened_run.LinearRun((0.0, 0.0), U, even, None, np.eye(3), noise=noise, f=f)

    def scores(values):
        log_S = replace(noise, values=values).basis(f) @ values
        return np.real(U.T.conj() @ (np.exp(-log_S) * (U @ run.free_coefficients)))

    assert np.abs(scores(np.zeros(3))[1:]).max() < 1e-9  # of a least-squares fit
    step = 1e-5
    change = np.array([(scores(step * e) - scores(-step * e)) / (2 * step) for e in np.eye(3)])
    assert run.psd_scores == pytest.approx(change.T @ noise.covariance @ change, rel=1e-6)
    # the covariance of the estimates, and lmfit's, are those of a sandwich with these scores
    estimate = run_estimate("A", run)
    model = JointModel([estimate])
    result = model.fit(params_of("abc", np.zeros(3)))
    H, M = run.H[1:, 1:], run.M[1:, 1:] + run.psd_scores[1:, 1:]
    expected = np.linalg.solve(H, np.linalg.solve(H, M).T)
    assert model.covariance(result.params) == pytest.approx(expected)
    assert result.covar == pytest.approx(expected)
    assert result.uvars["b"].std_dev == pytest.approx(np.sqrt(expected[1, 1]))
    assert run_estimate("A", replace(run, noise=None)).root == pytest.approx(estimate.root)


def test_own_residual_replaces_a_missing_noise_run():
    world = World(bump=10e-15)
    run, noise = pair(world, seed=2)
    unpaired, paired = fit_one([run]), fit_one([run, noise])
    assert "no_noise_run" in {w.code for w in unpaired.warnings}
    for name in NAMES:
        assert unpaired.parameters[name].sigma == pytest.approx(paired.parameters[name].sigma, rel=0.25)
        difference = unpaired.parameters[name].value - paired.parameters[name].value
        assert abs(difference) < paired.parameters[name].sigma


def test_missing_samples_are_masked_and_counted():
    world = World()
    run, noise = pair(world, seed=3)
    holed = without(run, (4000, 4120), (12000, 12040), (15000, 15001))
    fit = fit_one([holed, noise])
    assert fit.masked_samples == 161
    assert max(abs(p) for p in pulls(fit, of_run(world, "A")).values()) < 4
    assert fit.chi2 / fit.dof == pytest.approx(1, abs=0.15)


@pytest.mark.stat  # fails once in 1,000
def test_run_of_a_single_tone_is_known_as_well_as_its_psd():
    plan = thirteen.PLANS["D3"]
    plant = thirteen.plant_of(plan, thirteen.TRUTH)
    squares = []
    for seed in range(12):
        run_setup = replace(thirteen.made("D3", "sysid", seed), duration=6 * 3600.0)
        run_setup = replace(run_setup, drive=Drive(guidance_12=((1800.0, 1 / 300, 7e-9, 60),)))
        noise = thirteen.telemetry(thirteen.made("D3", "noise", seed))
        (experiment,) = whitening.pair([thirteen.telemetry(run_setup), noise])
        solution = fit_experiment(experiment).solution
        squares.append(((solution.theta[2] - plant.omega2_2) / solution.sigma[2]) ** 2)
    assert stats.chi2.sf(sum(squares), len(squares)) > 1e-3


def test_noise_that_creeps_comes_to_rest(monkeypatch):
    # In this draw the PSD of the lowest bin nears its place by 4 % an iteration, and a fit that iterates
    # plainly stops 0.018 sigma before it.
    campaign = replace(loading.load(ROOT / "campaigns" / "mission-x.toml"), seed=777)
    of_G3 = [r for r in numbered(campaign, 928, redraw=True).runs if r.experiment == "G3"]
    simulator = SpectralSimulator()
    runs = [simulator.draw(r, np.random.default_rng([928, r.seed, *r.name.encode()])) for r in of_G3]
    accelerated = fit_one(runs)
    monkeypatch.setattr(weighings, "LATE", 10**6)
    monkeypatch.setattr(irls, "TOLERANCE", 1e-5)
    monkeypatch.setattr(irls, "MAX_ITERATIONS", 300)
    converged = fit_one(runs)
    assert converged.converged
    for name, estimate in converged.parameters.items():
        assert abs(accelerated[name].value - estimate.value) < 2e-3 * estimate.sigma
