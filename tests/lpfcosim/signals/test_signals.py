"""Injections and noise: shapes, levels, spectra, independence of order."""

import numpy as np
import pytest

from lpfcosim.models import stimuli
from lpfcosim.signals import injected
from lpfcosim.spacecraft import HalfCosine, Sine

TARGETS = ("guidance_o_1", "guidance_o_12", "F_x_1", "F_x_2")


# --- injections -----------------------------------------------------------------------------------------


def test_without_injections_every_channel_is_exactly_zero(make_run):
    injected = stimuli.injections(make_run())
    assert tuple(injected) == TARGETS
    assert all(not values.any() and values.shape == (6000,) for values in injected.values())


def test_a_sine_has_its_cycles_and_nothing_else(make_run):
    run = make_run(injections=(Sine("guidance_o_12", 10e-9, 13.33e-3, 4, 100.0),))
    signal = stimuli.injections(run)["guidance_o_12"]
    t = run.time
    inside = (t >= 100.0) & (t < 100.0 + 4 / 13.33e-3)
    np.testing.assert_allclose(
        signal[inside], 10e-9 * np.sin(2 * np.pi * 13.33e-3 * (t[inside] - 100)), atol=1e-20
    )
    assert not signal[~inside].any()
    assert np.count_nonzero(np.diff(np.sign(signal[inside][1:]))) == 7  # 4 cycles cross zero 7 times inside


def test_half_cosine_rises_smoothly_and_stays(make_run):
    run = make_run(injections=(HalfCosine("F_x_1", 4e-9, 100.0, 300.0),))
    signal = stimuli.injections(run)["F_x_1"]
    assert not signal[:1001].any()
    assert signal[2000] == pytest.approx(2e-9)
    assert (signal[3000:] == 4e-9).all()
    assert (np.diff(signal) >= 0).all()
    # no kink at either end: the steepest step is pi/2 times the mean slope, the first almost nothing
    assert np.diff(signal).max() == pytest.approx(np.pi / 2 * 4e-9 / 2000, rel=1e-4)
    assert signal[1001] < 1e-14


def test_set_points_grow_at_the_stated_rate(make_run):
    run = make_run()
    signals = injected(run, TARGETS, {"guidance_phi": 2e-6}, start=100, stop=300)
    np.testing.assert_allclose(signals["guidance_phi"], 2e-6 * run.time[100:300], rtol=1e-12)


# --- noise ----------------------------------------------------------------------------------------------


def test_noise_depends_on_seed_run_and_name_only(make_run):
    level = {"oms": 1.0, "thruster": 1.0, "plateau": 1.0, "tail": 1.0, "f_x_1_jitter": 1.0}
    reference = stimuli.noise(make_run(noise=level, seed=7))
    again = stimuli.noise(make_run(noise=level, seed=7, n_samples=500))  # another length, same beginning
    one = stimuli.noise(make_run(noise={"thruster": 1.0}, seed=7))["F_noise_x_sc"]
    for name, values in reference.items():
        np.testing.assert_array_equal(again[name], values[:500])
    np.testing.assert_array_equal(one, reference["F_noise_x_sc"])
    draws = [*reference.values()]
    draws += stimuli.noise(make_run(noise=level, seed=8)).values()
    draws += stimuli.noise(make_run(noise=level, seed=7, name="other")).values()
    assert len({values[10] for values in draws}) == len(draws)


def density(values, low, high):
    """Frequencies within [low, high] Hz and the one-sided periodogram there, Hann window."""
    window = np.hanning(len(values))
    power = 2 * np.abs(np.fft.rfft(values * window)) ** 2 / (10.0 * (window**2).sum())
    f = np.fft.rfftfreq(len(values), 0.1)
    band = (f >= low) & (f <= high)
    return f[band], power[band]


def assert_ratio_is_one(ratio):
    """Fail by chance once in a million: 5 sigma of the mean of a periodogram, halved bins for the window."""
    assert ratio.mean() == pytest.approx(1.0, abs=5 / np.sqrt(len(ratio) / 2))


@pytest.mark.stat
@pytest.mark.parametrize(("name", "asd"), [("n_1", 35e-15), ("n_12", 35e-15), ("F_noise_x_sc", 0.15e-6)])
def test_white_noise_has_its_level(make_run, flight_noise, name, asd):
    """False-positive probability 1e-6 a spectrum."""
    values = stimuli.noise(make_run(noise=flight_noise, n_samples=216_000))[name]
    assert values.std() == pytest.approx(asd * np.sqrt(5), rel=5 / np.sqrt(2 * 216_000))
    for low, high in ((1e-3, 0.1), (0.1, 1), (1, 5)):
        _, power = density(values, low, high)
        assert_ratio_is_one(power / asd**2)


@pytest.mark.stat
def test_delta_g_has_its_plateau_and_tail(make_run, flight_noise):
    """False-positive probability 1e-6 a band; Delta g = g_2 - g_1 carries both halves."""
    noise = stimuli.noise(make_run(noise=flight_noise, n_samples=2_000_000))
    delta_g = noise["g_2"] - noise["g_1"]
    for low, high in ((1e-4, 1e-3), (1e-3, 1e-2), (1e-2, 1)):
        f, power = density(delta_g, low, high)
        assert_ratio_is_one(power / (5.6e-15**2 + (1.5 * 60e-15 * 20e-6 / f) ** 2))
    halves = [density(noise[g], 1e-2, 1)[1].mean() for g in ("g_1", "g_2")]
    assert halves == pytest.approx([5.6e-15**2 / 2] * 2, rel=0.02)
    assert abs(np.corrcoef(np.diff(noise["g_1"]), np.diff(noise["g_2"]))[0, 1]) < 5 / np.sqrt(2_000_000)


@pytest.mark.stat
def test_the_tail_is_stationary_from_its_first_sample(make_run):
    """Its variance is that of a first-order process, slope^2 pi / (2 corner); false positive 1e-6."""
    first, last = [], []
    for seed in range(400):
        values = stimuli.noise(make_run(noise={"tail": 1.0}, seed=seed, n_samples=2))["g_1"]
        first.append(values[0])
        last.append(values[1])
    expected = (60e-15 * 20e-6) ** 2 / 2 * np.pi / (2 * 2e-6)
    assert np.var(first) == pytest.approx(expected, rel=5 * np.sqrt(2 / 400))
    assert np.var(last) == pytest.approx(expected, rel=5 * np.sqrt(2 / 400))


@pytest.mark.stat
def test_jitter_falls_as_1_over_f_above_a_flat_part(make_run):
    """False-positive probability 1e-6 a band."""
    jitter = stimuli.noise(make_run(noise={"f_x_1_jitter": 1e-14}, n_samples=2_000_000))["f_x_1_jitter"]
    for low, high in ((5e-4, 2e-3), (2e-3, 0.1)):
        f, power = density(jitter, low, high)
        assert_ratio_is_one(power * (f / 1e-3) ** 2 / 1e-28 * (1 + (1e-4 / f) ** 2))
    f, power = density(jitter, 5e-6, 3e-5)
    assert_ratio_is_one(power / 1e-26 * (1 + (f / 1e-4) ** 2))
