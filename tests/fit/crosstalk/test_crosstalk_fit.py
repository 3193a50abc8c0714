"""Cross-talk of spacecraft motion: in the equation, in the joint fit, in what is reported of it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fit.checks import as_fit
from fit.crosstalk import attenuation, crosstalk_fit, instrumental_variables, readout_noise
from fit.crosstalk.crosstalk_fit import cross_talk
from fit.crosstalk.fitted_run import fitted_runs
from fit.fitting.experiment_and_joint_fit import fit_experiment, fit_joint
from fit.model import dynamics
from fit.model.sharing import Sharing
from fit.settings import settings
from fit.spectra import derivatives
from fit.whitening import Experiment
from fit.whitening.run import Run
from tests.oracles.bump_synthetic import TRUTH, Motion, blind, jitter, pair, run
from tests.oracles.synthetic import World, of_run

SHARING = Sharing(settings().shared)

LATE = World(plateau=2e-15, tail=8e-15)
CLEAN = Motion(grs=0.0, dws=0.0)
NAMES = list(TRUTH)


def experiments(runs):
    return [Experiment(Run(sysid), Run(noise)) for sysid, noise in zip(runs[::2], runs[1::2], strict=True)]


def two_epochs(motion, second_motion=None, **options):
    return experiments(
        pair(motion, LATE, "A", epoch=1, **options)
        + pair(motion, LATE, "B", epoch=1, **options)
        + pair(second_motion or motion, LATE, "C", epoch=2, **options)
    )


def fitted(runs):
    outcome = fit_joint(runs, settings())
    return outcome, cross_talk(outcome, runs, SHARING, attenuation.correct_attenuation(outcome, runs))


@pytest.fixture(scope="module")
def noisy():
    runs = two_epochs(Motion())
    return runs, *fitted(runs)


def pulls(fit, truth):
    return {name: (e.value - truth[name]) / e.sigma for name, e in fit.parameters.items()}


def warning(fit, code):
    (match,) = (w for w in fit.warnings if w.code == code)
    return match


def in_band(x, low, high):
    """Return the rms of a 1 Hz series between two frequencies, by a plain windowed transform."""
    f = np.fft.rfftfreq(x.size)
    power = np.abs(np.fft.rfft(x * np.hanning(x.size))[(f > low) & (f < high)]) ** 2
    return float(np.sqrt(np.sum(power)))


@pytest.mark.parametrize("name", NAMES)
def test_every_term_has_its_sign_and_size(name):
    only = {**dict.fromkeys(TRUTH, 0.0), name: TRUTH[name]}
    recorded, truth = run(Motion(b=only, grs=0.0, dws=0.0), LATE, kind="noise", duration=7200.0)
    delta_g_SC, _ = dynamics.delta_g_SC(recorded, only)
    expected = truth["delta_g_SC"][derivatives.HALF : -derivatives.HALF]
    assert in_band(delta_g_SC - expected, 1e-3, 0.1) < 1e-6 * in_band(expected, 1e-3, 0.1)


def test_delta_g_is_the_simulated_one():
    noiseless = replace(LATE, oms=0.0)
    recorded, truth = run(CLEAN, noiseless, kind="noise", duration=7200.0)
    parameters = of_run(noiseless, "A")
    time, delta_g = dynamics.residual(recorded, parameters | TRUTH)
    _, delta_g_x = dynamics.residual(recorded, parameters)
    delta_g_SC, _ = dynamics.delta_g_SC(recorded, TRUTH)
    assert np.allclose(delta_g, delta_g_x + delta_g_SC, rtol=0, atol=1e-20)
    expected = truth["delta_g"][derivatives.HALF : -derivatives.HALF]
    assert in_band(delta_g - expected, 1e-3, 0.1) < 1e-3 * in_band(expected, 1e-3, 0.1)
    assert time.size == delta_g.size


def test_each_epoch_has_its_own_coefficients():
    # 12 + 9 pulls beyond 4.5 sigma: false-positive probability 1.5e-4
    second_truth = {name: -1.5 * value for name, value in TRUTH.items()}
    runs = two_epochs(CLEAN, replace(CLEAN, b=second_truth), seed=1)
    outcome, fits = fitted(runs)
    assert list(fits) == ["1", "2"]
    for fit, truth in zip(fits.values(), (TRUTH, second_truth), strict=True):
        assert list(fit.parameters) == NAMES
        assert max(abs(p) for p in pulls(fit, truth).values()) < 4.5
        assert [fit.parameters[n].sigma for n in NAMES] == pytest.approx(
            np.sqrt(np.diag(fit.covariance_matrix))
        )
        assert [w.code for w in fit.warnings] == ["correlation"]
        assert fit.parameters["b_1"].unit == "m rad-1"
        assert fit.parameters["b_6"].unit == "s-2"
    joint = as_fit(outcome, runs)
    assert not any(name.startswith("b_") for name in joint.parameters)
    assert max(abs(p) for p in pulls(joint, vars(LATE)).values()) < 4.5


def test_noisy_read_outs_attenuate_least_squares(noisy):
    # The PSDs of true motion and read-out noise are known here: so is the least-squares limit, but for the
    # weights, that depend little on frequency where the bump is large.
    runs, outcome, _ = noisy
    floors = [readout_noise.noise_psd(e.sysid) for e in runs]
    shift = attenuation.expected_shift(outcome, fitted_runs(outcome, runs), floors)
    shift = dict(zip([p.name for p in outcome.parameters], shift, strict=True))
    for epoch, coefficients in crosstalk_fit.subtraction(outcome, runs, SHARING).items():
        assert list(coefficients) == NAMES
        for name in ("b_3", "b_4"):
            assert 0.84 < coefficients[name] / TRUTH[name] < 0.94
            # what the data tell of their own noise makes good for it, but for the answer of the loop to it
            assert coefficients[name] - shift[f"{name}_{epoch}"] == pytest.approx(TRUTH[name], rel=0.04)


def test_two_sensors_of_the_same_motion_free_the_couplings(noisy):
    # 12 pulls beyond 4.5 sigma: false-positive probability 1e-4
    _, outcome, fits = noisy
    sigma = dict(zip([p.name for p in outcome.parameters], outcome.solution.sigma, strict=True))
    for epoch, fit in fits.items():
        assert max(map(abs, pulls(fit, TRUTH).values())) < 4.5
        assert [w.code for w in fit.warnings] == ["instrumental_variables", "correlation"]
        assert warning(fit, "instrumental_variables").parameters == ("b_3", "b_4", "b_5", "b_6")
        cost = {name: e.sigma / sigma[f"{name}_{epoch}"] for name, e in fit.parameters.items()}
        assert [cost["b_1"], cost["b_2"]] == pytest.approx([1, 1], abs=0.1)
        assert all(1.7 < cost[name] < 2.8 for name in ("b_3", "b_4"))
        assert fit.parameters["b_3"].sigma < 0.03 * TRUTH["b_3"]  # least squares is off by a tenth
        assert np.array_equal(fit.covariance_matrix, fit.covariance_matrix.T)


def test_gains_that_may_scatter_leave_the_couplings_as_they_are(noisy):
    """A gain of each experiment's own and one for all are separated by the width that the data gave."""
    runs, _, plain = noisy
    outcome = fit_joint(runs, settings({"scatter": ["lambda_2"]}))
    fits = cross_talk(outcome, runs, SHARING, attenuation.correct_attenuation(outcome, runs))
    for epoch, fit in plain.items():
        assert fits[epoch].parameters.keys() == fit.parameters.keys()
        for name, e in fit.parameters.items():
            estimate = fits[epoch].parameters[name]
            assert abs(estimate.value - e.value) < 0.3 * e.sigma
            assert estimate.sigma == pytest.approx(e.sigma, rel=0.1)


def wandering(recorded, seed):
    """Let test mass 2 wander along y: its read-out measures another motion."""
    walk = np.cumsum(np.random.default_rng(seed).standard_normal(recorded.time.size))
    own_motion = 6e-10 * (walk - np.linspace(0, walk[-1], walk.size))
    return replace(
        recorded, channels={**recorded.channels, "grs_y_2": recorded.channels["grs_y_2"] + own_motion}
    )


@pytest.mark.parametrize(
    "altered",
    [
        wandering,
        # without angles, rotation is all that the two read-outs are known to differ by
        lambda recorded, _: blind(recorded, "o_phi_1", "o_phi_12"),
    ],
)
def test_read_outs_that_differ_by_more_than_noise_are_no_instruments(altered):
    runs = [altered(recorded, seed) for seed, recorded in enumerate(pair(Motion(), LATE))]
    fit = fitted(experiments(runs))[1]["1"]
    assert {"b_3"} <= set(warning(fit, "attenuation_bias").parameters) <= {"b_3", "b_5"}
    assert warning(fit, "instrumental_variables").parameters == ("b_4", "b_6")


def subtraction(run, parameters, edges):
    """Return the PSDs of Delta g_x, of Delta g, and what is left of Delta g_x at best, in bands of frequency.

    At best (Wiener): no combination of the noisy read-outs, even with other complex coefficients in every
    band, leaves less.
    """
    theta = np.array([parameters.get(name, 0.0) for name in run.channels.parameters])
    terms = run.spectra(dynamics.delays(theta))
    c, split = dynamics.coefficients(theta, terms.tau), len(dynamics.COLUMNS)
    delta_g_x = terms.columns[:, :split] @ c[:split]
    delta_g = delta_g_x + terms.columns[:, split:] @ c[split:]
    powers = []
    for low, high in pairwise(edges):
        band = (terms.f >= low) & (terms.f < high)
        x, target = terms.columns[band, split : split + 4], delta_g_x[band]  # phi'', eta'', y'', z''
        remainder = target - x @ np.linalg.lstsq(x, target)[0]
        free = band.sum() - x.shape[1]  # a fit to n bins takes out one bin's power a coefficient
        power = [np.mean(np.abs(y[band]) ** 2) for y in (delta_g_x, delta_g)]
        powers.append([*power, np.sum(np.abs(remainder) ** 2) / free])
    return np.array(powers).T


def test_bump_falls_to_the_limit_of_its_noisy_regressors(noisy):
    runs, outcome, _ = noisy
    b = crosstalk_fit.subtraction(outcome, runs, SHARING)["1"]
    edges = np.array([25, 35, 45, 60]) * 1e-3
    uncorrected, corrected, wiener = subtraction(runs[0].noise, of_run(LATE, "A") | b, edges)
    assert np.sqrt(uncorrected / corrected)[0] > 3
    assert np.all(np.sqrt(corrected / wiener) < 1.2)
    # Wiener's limit from the spectra that were put in
    f = np.linspace(edges[:-1], edges[1:], 50)
    omega2 = (2 * np.pi * f) ** 2
    limit = LATE.plateau**2 + (omega2 * LATE.oms) ** 2
    for name, mean, noise in (("b_1", "phi", 1.12 * 150e-12), ("b_3", "y", 2e-9 / np.sqrt(2))):
        S, S_n = jitter(mean, f) ** 2, noise**2
        squares = TRUTH[name] ** 2 + TRUTH[f"b_{int(name[2:]) + 1}"] ** 2
        limit += squares * omega2**2 * S * S_n / (S + S_n)
    assert np.sqrt(wiener) == pytest.approx(np.sqrt(limit.mean(axis=0)), rel=0.1)


@pytest.mark.long
@pytest.mark.stat
def test_the_pulls_of_couplings_are_standard_normal():
    # 100 fits of six coefficients; least squares has mean pulls of 7 to 14 sigma for b_3 to b_6. Mean within
    # 0.45, 4.5 standard errors; sum of squared pulls within the 1e-5 quantiles of chi^2(100): false-positive
    # probability 2e-4.
    all_pulls = []
    for seed in range(100):
        runs = [r for authority in "AB" for r in pair(Motion(), LATE, authority, seed=seed)]
        all_pulls.append(list(pulls(fitted(experiments(runs))[1]["1"], TRUTH).values()))
    all_pulls = np.array(all_pulls)
    assert np.all(np.abs(all_pulls.mean(axis=0)) < 0.45)
    assert np.all((np.sum(all_pulls**2, axis=0) > 51.0) & (np.sum(all_pulls**2, axis=0) < 170.0))


@pytest.mark.slow
def test_attenuated_coefficients_hardly_move_the_dynamics():
    # Thrusters askew by 1 % move y and z with x_1. Same Delta g with and without read-out noise in the
    # regressors: measured over 24 runs, the noise moves no parameter by more than 0.2 sigma on the mean.
    motion, shifts = Motion(tilt=0.01), []
    for seed in range(4):
        noisy, clean = (
            fit_experiment(*experiments(pair(m, LATE, seed=seed))).solution
            for m in (motion, replace(motion, grs=0.0, dws=0.0))
        )
        shifts.append(((noisy.theta - clean.theta) / np.sqrt(np.diag(noisy.covariance)))[:5])
    assert np.all(np.abs(np.mean(shifts, axis=0)) < 0.5)


def test_instruments_of_a_bin_do_not_depend_on_the_bin(noisy):
    # louder by a tenth, it moves those of its neighbours; tied to its own noise, instruments would attenuate
    runs, outcome, _ = noisy
    w, theta = fitted_runs(outcome, runs)[0], outcome.solution.theta
    filters = instrumental_variables.noisy_regressor(w, "y", theta).filters
    for i in (400, 600, 800, 1000):
        columns = w.terms.columns.copy()
        columns[i, w.experiment.parameters.index("b_3") + 1] *= 1.05
        perturbed = instrumental_variables.noisy_regressor(
            replace(w, terms=replace(w.terms, columns=columns)), "y", theta
        ).filters
        change = np.abs(perturbed[:, 2] / filters[:, 2] - 1)
        assert change[i] < 0.2 * change[i + 1]
