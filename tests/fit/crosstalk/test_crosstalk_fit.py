"""Cross-talk of spacecraft motion: in the equation, in the joint fit, in what is reported of it."""

from dataclasses import replace

import numpy as np
import pytest

from fit.checks import as_fit
from fit.crosstalk import attenuation, crosstalk_fit, instrumental_variables, readout_noise
from fit.crosstalk.crosstalk_fit import cross_talk
from fit.crosstalk.fitted_run import fitted_runs
from fit.fitting.experiment_and_joint_fit import fit_joint
from fit.model import dynamics
from fit.model.sharing import Sharing
from fit.settings import settings
from fit.spectra import derivatives
from fit.whitening import Experiment
from fit.whitening.run import Run
from tests.oracles.bump_synthetic import TRUTH, Motion, blind, pair, run
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


def test_the_sigma_holds_what_experiments_differ_by():
    def fit_of(*shifts):
        b = [TRUTH | {"b_1": TRUTH["b_1"] + shift} for shift in shifts]
        runs = [r for x, name in zip(b, "ABC", strict=True) for r in pair(replace(CLEAN, b=x), LATE, name)]
        return fitted(experiments(runs))[1]["1"]

    steady = fit_of(0.0, 0.0, 0.0)
    assert "cross_talk_drift" not in [w.code for w in steady.warnings]
    shift = 30 * steady["b_1"].sigma
    fit = fit_of(-shift, 0.0, shift)
    assert warning(fit, "cross_talk_drift").parameters == ("b_1",)
    sigma = fit["b_1"].sigma
    assert sigma == pytest.approx(shift / np.sqrt(3), rel=0.15)
    assert abs(fit["b_1"].value - TRUTH["b_1"]) < sigma
    assert fit.covariance_matrix[0, 0] / sigma**2 == pytest.approx(1)
    for name in ("b_2", "b_3"):
        assert fit[name].sigma == pytest.approx(steady[name].sigma, rel=0.1)


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


def test_the_noise_of_means_is_measured(noisy):
    # of the mean of two read-outs alike, and of an angle plus half of a difference; 900 bins
    floor, motion = readout_noise.noise_psd(noisy[0][0].sysid), Motion()
    expected = dict.fromkeys("yz", motion.grs**2 / 2) | dict.fromkeys(("phi", "eta"), 1.25 * motion.dws**2)
    assert floor == pytest.approx(expected, rel=0.2, abs=0)


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


def test_the_subtraction_makes_delta_g_three_times_as_quiet(noisy):
    runs, outcome, _ = noisy
    b, run = crosstalk_fit.subtraction(outcome, runs, SHARING)["1"], runs[0].noise.telemetry
    levels = [in_band(dynamics.residual(run, of_run(LATE, "A") | c)[1], 25e-3, 35e-3) for c in ({}, b)]
    assert levels[0] > 3 * levels[1]


def test_instruments_hold_the_noise_and_the_force_of_a_mean(noisy):
    runs, outcome, _ = noisy
    w, theta = fitted_runs(outcome, runs)[0], outcome.solution.theta
    places = [w.experiment.parameters.index(name) for name in ("b_3", "b_5")]
    b, terms, f = w.block.parameter_map[places] @ theta, w.terms.columns[:, np.add(places, 1)], w.terms.f
    mean = instrumental_variables.noisy_regressor(w, "y", theta)
    S_m = Motion().grs ** 2 / 2  # of the mean of two read-outs
    assert mean.noise_power * w.S / (2 * (2 * np.pi * f) ** 4 * S_m) == pytest.approx(1, rel=0.1)
    # the position, and the force of both (Eq. (3)), per acceleration; causal functions have one modulus
    moving, modulus = (f > 1e-3) & (f < 1e-2), np.hypot(1, f / 40e-3)
    force = np.abs(mean.loop[:, 0]) / mean.noise_power * modulus
    found = np.stack([mean.filters[:, 1], force])[:, moving]
    expected = (np.stack([terms[:, 1], np.abs(terms @ b / terms[:, 0]) * terms[:, 0]]) / terms[:, 0])[
        :, moving
    ]
    assert np.median(np.abs(found / expected - 1), axis=1) == pytest.approx([0, 0], abs=0.06)
    assert np.all(np.abs(mean.filters[:, 2]) * modulus < 1.001 * force)  # its share of noise is at most 1


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
