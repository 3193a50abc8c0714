"""The Euler fit on telemetry of closed rotation loops that shares no code with it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy
from scipy.signal import csd, welch

from fit.crosstalk import torque_noise
from fit.model import angular_rate, rotation
from tests.fit.crosstalk.euler import (
    DAY,
    LOW_NOISE,
    TRUTH,
    codes,
    fitted,
    lacking,
    pulls,
)
from tests.fit.fitting.linear_equation import params_of
from tests.oracles.rotation_synthetic import run


def test_recovers_both_angles_with_the_expected_sigmas(three_day_fit):
    fit = three_day_fit
    assert list(fit.parameters) == ["delta_phi", "delta_eta"]
    assert max(map(abs, pulls(fit))) < 4.5
    # The noise of 2016 over 3 d allows 0.022 and 0.0048 mrad, more or less as the spacecraft happens to turn.
    assert fit.parameters["delta_phi"].sigma == pytest.approx(0.020e-3, rel=0.35)
    assert fit.parameters["delta_eta"].sigma == pytest.approx(0.0042e-3, rel=0.35)
    assert fit.parameters["delta_phi"].unit == "rad"
    assert np.sqrt(np.diag(fit.covariance_matrix)) == pytest.approx(
        [e.sigma for e in fit.parameters.values()]
    )
    assert fit.chi2 / fit.dof == pytest.approx(1, abs=0.05)
    assert codes(fit) == {"degenerate_with_actuation_crosstalk"}
    assert "cannot separate" in fit.warnings[0].message


def test_the_stiffness_multiplies_lengths_in_the_read_out_too(quiet_day_fit):
    # Same noise, four times the cross-talk: without omega2_2 phi beside phi'' delta_eta would move by 0.7 %.
    world = replace(LOW_NOISE, b_1=4 * LOW_NOISE.b_1, b_2=4 * LOW_NOISE.b_2)
    strong = fitted(run(world, duration=DAY)[0], world=LOW_NOISE)
    for name, estimate in strong.parameters.items():
        assert estimate.value == pytest.approx(quiet_day_fit.parameters[name].value, rel=0.0015)


def gain(x, y, low, high):
    """Return the transfer from x to y, averaged over a band [Hz] at 1 Hz sampling."""
    f, across = csd(x, y, 1.0, nperseg=x.size // 3, detrend="linear")
    _, power = welch(x, 1.0, nperseg=x.size // 3, detrend="linear")
    band = (f > low) & (f < high)
    return across[band].sum() / power[band].sum()


def test_the_torque_alone_overshoots_and_the_angle_cures_it(three_days):
    telemetry, truth = three_days
    sources = rotation.sources(telemetry)
    motion = rotation.motion(telemetry, sources)
    dOmega = truth["dOmega_eta"][10:-10]
    for low, high in ((0.2e-3, 0.4e-3), (0.8e-3, 1.2e-3)):
        assert abs(gain(dOmega, motion.dOmega[:, 1], low, high) - 1) < 0.01
    torque = telemetry.channels["N_eta_1"][10:-10] / sources.inertia["eta"]
    assert abs(gain(dOmega, torque, 0.8e-3, 1.2e-3)) == pytest.approx(1.32, abs=0.06)  # as known for 2 mHz


def test_test_masses_that_turn_differently_measure_the_same_rotation(quiet_day):
    telemetry, omega2 = quiet_day[0], -1.5e-6
    phases = [2 * np.pi * f * telemetry.time for f in (1e-3, 1.7e-3, 2.3e-3)]
    dOmega, *angles = [a * np.sin(phase) for a, phase in zip((1e-9, 3e-6, 5e-6), phases, strict=True)]
    channels = {"o_phi_1": angles[0], "o_phi_12": angles[1] - angles[0]}
    for j, f in ((1, 1.7e-3), (2, 2.3e-3)):
        stiffness = omega2 - (2 * np.pi * f) ** 2
        channels[f"N_phi_{j}"] = 1.928 * 0.046**2 / 6 * (dOmega + stiffness * angles[j - 1])
    telemetry = replace(telemetry, channels=telemetry.channels | channels)
    sources = rotation.sources(telemetry)
    assert np.abs(rotation.motion(telemetry, sources).dOmega[:, 0] - dOmega[10:-10]).max() < 1e-15
    assert np.abs(rotation.half_difference(telemetry, sources)[:, 0]).max() < 1e-15


def test_the_integral_is_neither_early_nor_late():
    phase, integral = 2 * np.pi * 1e-3 * np.arange(3000), angular_rate.Integral(1.0)
    parts = [integral(np.cos(part)[:, None]) for part in np.split(phase, [1000])]
    assert np.abs(np.concatenate(parts)[:, 0] * phase[1] - np.sin(phase)).max() < 1e-5


def test_rate_is_neither_star_tracker_noise_nor_drift(three_days):
    telemetry, truth = three_days
    motion = rotation.motion(telemetry, rotation.sources(telemetry))
    slow = angular_rate.slow_rate(telemetry.path, [motion], motion.time[0], motion.time[-1])
    Omega = angular_rate.rate(motion, slow, angular_rate.Integral(motion.fs))
    for i, axis in enumerate(rotation.AXES):
        wrong = Omega[:, i] - truth[f"Omega_{axis}"][10:-10]
        assert abs(wrong.mean()) < 1e-9  # of 3e-8 and 2e-7 rad/s
        assert np.abs(wrong).max() < 3e-8
        f, S = welch(wrong, 1.0, nperseg=wrong.size // 2, detrend="linear")
        _, whole = welch(truth[f"Omega_{axis}"], 1.0, nperseg=wrong.size // 2, detrend="linear")
        band = (f > 80e-6) & (f < 2e-3)
        assert S[band].sum() < 0.01 * whole[: f.size][band].sum()


def test_two_test_masses_free_the_angles_of_their_torque_noise():
    # Of dOmega_phi some 6 % are noise, with one test mass some 13 %. False-positive probability 1e-6.
    world = replace(LOW_NOISE, torque=1e-11)
    telemetry = run(world, duration=2 * DAY)[0]
    both, one = fitted(telemetry, world=LOW_NOISE), fitted(lacking(telemetry, "N_phi_2"), world=LOW_NOISE)
    assert max(map(abs, pulls(both))) < 5
    assert both.parameters["delta_phi"].sigma < 0.02 * abs(TRUTH["delta_phi"])
    assert codes(both) == {"degenerate_with_actuation_crosstalk"}
    assert one.parameters["delta_phi"].value / TRUTH["delta_phi"] == pytest.approx(0.86, abs=0.04)
    (warning,) = (w for w in one.warnings if w.code == "one_test_mass")
    assert warning.parameters == ("delta_phi",)


def test_the_angles_solve_the_normal_equations_without_the_noise():
    H, noise, angles = np.array([[4.0, 1.0], [1.0, 3.0]]), np.diag([0.4, 0.9]), np.array([2.0, -1.0])
    run = SimpleNamespace(
        H=scipy.linalg.block_diag(1.0, H),
        gradient=lambda _: np.eye(3, 2, k=-1),
        torque_noise=lambda _: (noise, np.zeros((2, 2))),
        calibration_moments=lambda: np.zeros((2, 1)),
    )
    outcome = SimpleNamespace(
        solution=SimpleNamespace(theta=angles, covariance=np.linalg.inv(H)),
        parameters=[SimpleNamespace(prior_sigma=1.0)] * 2,
        whitened_runs=[run],
        free=np.eye(2),
        result=SimpleNamespace(params=params_of("ab", angles)),
    )
    theta, covariance, _ = torque_noise.bias_corrected(outcome, np.zeros((1, 1)))
    assert (H - noise) @ theta == pytest.approx(H @ angles)
    assert (H - noise) @ covariance @ (H - noise) == pytest.approx(H)


def test_torsional_stiffness_counts(quiet_day, quiet_day_fit):
    telemetry = quiet_day[0]
    bare = replace(telemetry, attributes={})
    fit = fitted(bare, world=LOW_NOISE)
    (warning,) = (w for w in fit.warnings if w.code == "no_torsional_stiffness")
    assert warning.parameters == ("delta_phi", "delta_eta")
    for name, estimate in fit.parameters.items():
        ratio = estimate.value / quiet_day_fit.parameters[name].value
        assert 0.97 < ratio < 0.987  # the 2 % of the warning
    doubled = replace(telemetry, attributes={**telemetry.attributes, "I_zz": 2 * 1.928 * 0.046**2 / 6})
    double = fitted(lacking(doubled, "o_phi", "o_eta"), world=LOW_NOISE).parameters["delta_phi"].value
    single = fitted(lacking(telemetry, "o_phi", "o_eta"), world=LOW_NOISE).parameters["delta_phi"].value
    assert double == pytest.approx(2 * single, rel=0.15)  # not exactly: Omega doubles too


def test_an_attitude_of_the_other_sense_is_seen_and_reversed(quiet_day, quiet_day_fit):
    telemetry = quiet_day[0]
    backwards = {k: -v if k.startswith("ast") else v for k, v in telemetry.channels.items()}
    fit = fitted(replace(telemetry, channels=backwards), world=LOW_NOISE)
    assert "star_tracker_reversed" in codes(fit)
    for name, estimate in quiet_day_fit.parameters.items():
        assert fit.parameters[name].value == pytest.approx(estimate.value, rel=1e-9)
