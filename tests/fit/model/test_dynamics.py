"""The equation of motion: against Newton's equations, frequency by frequency, and the reference plant."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fit.model import dynamics
from fit.spectra import derivatives, windowing
from lpfcosim.models.one_axis import stiffnesses
from lpfcosim.spacecraft import Sine
from tests.fit.recorded import recorded
from tests.oracles.synthetic import World, of_run, telemetry, without
from tests.reference_run import simulate_reference

EPOCH_1 = {"lambda_1", "lambda_2", "C_1", "C_2", "omega2_2", "domega2_12", "delta_ifo"}


def parameters(world, authority="E"):
    return {name: value for name, value in of_run(world, authority).items() if name in EPOCH_1}


def rms(x):
    return float(np.sqrt(np.mean(x**2)))


@pytest.mark.parametrize("fs", [1.0, 2.0, 10.0])
def test_residual_of_noise_free_tones_vanishes(fs):
    world = World()
    run = telemetry(world, "E", duration=3600.0, drive_1=1e-12, noisy=False, fs=fs)
    _, signal = dynamics.residual(run, {})
    _, delta_g = dynamics.residual(run, parameters(world))
    assert rms(delta_g) < 1e-7 * rms(signal)


@given(
    theta=arrays(float, st.sampled_from([7, 11]), elements=st.floats(-2, 2)),  # without and with couplings
    tau=st.tuples(st.floats(0, 0.4), st.floats(0, 0.4)),
)
def test_gradient_is_the_derivative_of_the_coefficients(theta, tau):
    step = 1e-5
    numerical = [
        (dynamics.coefficients(theta + e, tau) - dynamics.coefficients(theta - e, tau)) / (2 * step)
        for e in step * np.eye(theta.size)
    ]
    assert np.allclose(dynamics.gradient(theta, tau), np.transpose(numerical), atol=1e-8)


def test_columns_do_not_depend_on_the_delay_they_are_expanded_about():
    world = World()
    channels = dynamics.channels(telemetry(world, "E", duration=3600.0, drive_1=1e-12))
    theta = np.array([parameters(world)[name] for name in dynamics.PARAMETERS])
    sums = []
    for tau in (dynamics.delays(theta), (0.1386, 0.1727)):
        terms = dynamics.columns(channels, tau)
        sums.append(terms.values @ dynamics.coefficients(theta, tau))
    assert rms(sums[0] - sums[1]) < 3e-9 * rms(channels.series["f_x_2"])


def test_delays():
    theta = np.array([1.1, 1.2, 0.22, 0.18, 0.0, 0.0, 0.0])
    assert dynamics.delays(theta) == pytest.approx((0.2, 0.15))
    assert dynamics.delays(0 * theta) == (0.0, 0.0)


def test_missing_samples_spoil_no_more_than_the_filters_reach():
    run = telemetry(World(), duration=3600.0)
    _, whole = dynamics.residual(run, {})
    time, holed = dynamics.residual(without(run, (1000, 1030), (2000, 2001)), {})
    lost = time[np.isnan(holed)]
    assert lost.min() == 1000 - derivatives.HALF
    assert lost.max() == 1029 + derivatives.HALF
    rest = ~np.isnan(holed)
    far = rest & (np.abs(time - 2000) > derivatives.HALF)
    assert np.array_equal(holed[far], whole[far])
    assert dynamics.channels(without(run, (1000, 1030), (2000, 2001))).missing == 31


def test_closed_loop_of_the_reference_plant_obeys_the_equation(make_run):
    injections = (
        Sine("guidance_o_12", 10e-9, 10e-3, 10, 100.0),
        Sine("guidance_o_1", 5e-9, 20e-3, 20, 200.0),
        Sine("F_x_1", 1e-12, 30e-3, 20, 300.0),
    )
    run = make_run(n_samples=15000, dc=5e-12, injections=injections)
    run = replace(run, authority=replace(run.authority, F_max_1=1100e-12), noise={})
    truth = {name: run.truth[name] for name in ("lambda_1", "lambda_2", "C_1", "C_2")}
    omega2_1, omega2_2 = stiffnesses(run, run.truth)
    truth |= {
        "omega2_2": omega2_2,
        "domega2_12": omega2_2 - omega2_1,
        "delta_ifo": run.truth["delta_ifo_1"],
    }
    simulated = recorded(run, simulate_reference(run))
    _, signal = dynamics.residual(simulated, {})
    _, delta_g = dynamics.residual(simulated, truth)
    assert np.median(delta_g) / 5e-12 == pytest.approx(1, rel=1e-5)
    # Injections that start and stop are not band-limited; the fit looks at the band alone.
    both = np.stack([delta_g - 5e-12, signal], axis=1)
    left, power = np.sum(
        np.abs(windowing.transform(both, np.ones(len(both), bool), 1.0).columns) ** 2, axis=0
    )
    assert left < (2e-6) ** 2 * power


def test_cross_talk_is_that_of_the_mean_motion_of_both_test_masses():
    run, omega = telemetry(World(), duration=4000.0), 2 * np.pi * np.array([0.01, 0.02])
    one, two = (np.sin(w * run.time) for w in omega)  # rad and m
    channels = {"o_phi_1": one, "o_phi_12": two - one, "grs_y_1": one, "grs_y_2": two}
    run = replace(run, channels=run.channels | channels)
    found, _ = dynamics.delta_g_SC(run, {"b_1": 2e-5, "b_5": 1e-7})
    means = 2e-5 * (-(omega[0] ** 2) * one - omega[1] ** 2 * two) / 2 + 1e-7 * (one + two) / 2
    assert np.abs(found - means[10:-10]).max() < 1e-6 * np.abs(means).max()


def test_torques_count_only_beside_angles_that_tell():
    t = np.arange(4000.0)
    rows = {
        name: np.sin(t / (50 + i)) for i, name in enumerate(("N_phi_1", "N_phi_2", "o_phi_1", "o_phi_12"))
    }

    def names(**changed):
        channels = {**telemetry(World(), duration=4000.0).channels, **rows, **changed}
        run = replace(telemetry(World(), duration=4000.0), channels=channels)
        return [name for name, _ in dynamics.means(run)]

    assert names() == ["phi", "N_phi"]
    assert names(o_phi_1=0 * t, o_phi_12=0 * t + 1e-6) == []
    assert names(N_phi_1=0 * t, N_phi_2=0 * t) == ["phi"]
