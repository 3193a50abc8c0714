"""Injections and noise: shapes, levels, spectra, independence of order."""

from itertools import pairwise

import numpy as np
import pytest
import scipy

from lpfcosim.models import model_of, stimuli
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
    assert signal[2000] == pytest.approx(2e-9, rel=1e-6, abs=0)
    assert (signal[3000:] == 4e-9).all()
    assert (np.diff(signal) >= 0).all()
    # no kink at either end: the steepest step is pi/2 times the mean slope, the first almost nothing
    assert np.diff(signal).max() == pytest.approx(np.pi / 2 * 4e-9 / 2000, rel=1e-4, abs=0)
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


LEVELS = {"oms": 35e-15, "thruster": 1.5e-7, "plateau": 5.6e-15, "tail": 1.5, "f_x_1_jitter": 1e-14}
LEVELS |= {"electrode": 2e-6}
PSD = {  # what is stated of each signal, and how closely a filter has it
    "n_1": (lambda f: np.full_like(f, 35e-15**2), 1e-12),
    "F_noise_x_sc": (lambda f: np.full_like(f, 1.5e-7**2), 1e-12),
    "g_1": (lambda f: (5.6e-15**2 + (1.5 * 60e-15 * 20e-6) ** 2 / (f**2 + 2e-6**2)) / 2, 1e-3),
    "f_x_1_jitter": (lambda f: 1e-34 / (f**2 + 1e-4**2), 2e-3),
    "e_x_2": (lambda f: 2e-6**2 * np.maximum(1, 1e-3 / f), 0.14),
}


@pytest.mark.parametrize("name", PSD)
def test_a_signal_has_the_spectrum_that_is_stated(make_run, name):
    run, f = make_run(noise=LEVELS), np.geomspace(1e-5, 0.1, 300)
    (source,) = (source for source in model_of(run).sources(run) if source.name == name)
    expected, tolerance = PSD[name]
    np.testing.assert_allclose(source.psd(f, run.h), expected(f), rtol=tolerance)


@pytest.mark.stat
def test_signals_are_drawn_with_their_spectra(make_run):
    """Means over bands of a periodogram, whose bins a Hann window correlates: 5 sigma, 1e-6 each."""
    n = 1_000_000
    run = make_run(noise=LEVELS, n_samples=n)
    noise = stimuli.noise_source(run)
    blocks = [noise.take(size) for size in (n // 2, 1, n // 2 - 1)]
    for source in model_of(run).sources(run):
        drawn = np.concatenate([block[source.name] for block in blocks])
        f, power = scipy.signal.periodogram(drawn, fs=run.fs, window="hann", detrend="constant")
        for low, high in pairwise((1e-4, 1e-3, 1e-2, 0.1, 1, 4.9)):
            band = (f > low) & (f < high)
            sigma = np.sqrt(35 / 18 / band.sum())
            assert abs(np.mean(power[band] / source.psd(f[band], run.h)) - 1) < 5 * sigma, (source.name, low)
    both = [np.diff(blocks[0][name]) for name in ("g_1", "g_2")]
    assert abs(np.corrcoef(both)[0, 1]) < 5 / np.sqrt(n / 2)


@pytest.mark.stat
def test_the_tail_is_stationary_from_its_first_sample(make_run):
    """Its variance is that of a first-order process, slope^2 pi / (2 corner); false positive 1e-6."""
    first, last = [], []
    for seed in range(400):
        values = stimuli.noise(make_run(noise={"tail": 1.0}, seed=seed, n_samples=2))["g_1"]
        first.append(values[0])
        last.append(values[1])
    expected = (60e-15 * 20e-6) ** 2 / 2 * np.pi / (2 * 2e-6)
    for drawn in (first, last):
        assert np.var(drawn) / expected == pytest.approx(1, rel=5 * np.sqrt(2 / 400))
