"""Filters, stencils, windows and the noise model against formulas."""

import numpy as np
import pytest

from fit.spectra import derivatives, windowing
from fit.spectra.noise_psd import fit_noise
from fit.whitening import whitened_run

BAND = np.array([1e-3, 13.33e-3, 53.33e-3, 0.1])  # Hz, at a sample rate of 1 Hz


def response(weights, f):
    k = np.arange(-(weights.size // 2), weights.size // 2 + 1)
    return np.exp(2j * np.pi * np.outer(f, k)) @ weights


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("shift", [0.0, 0.1, 0.186, 0.45, -0.3, 1.5])
def test_stencil_delays_and_differentiates_to_better_than_1e_7_in_the_band(shift, order):
    ideal = (2j * np.pi * BAND) ** order * np.exp(-2j * np.pi * BAND * shift)
    assert np.abs(response(derivatives.stencil(shift, order), BAND) / ideal - 1).max() < 1e-8


def test_second_derivative_lets_no_offset_or_drift_through():
    weights = derivatives.stencil(0.0, 2)
    k = np.arange(-derivatives.HALF, derivatives.HALF + 1)
    # 1e-14 s^-2 would be a ten-millionth of the stiffness
    assert abs(weights.sum()) < 1e-14
    assert abs(weights @ k) < 1e-13


def test_a_command_that_is_held_acts_as_weakly_as_its_mean_over_the_hold():
    f, delay, hold, t = 0.1, 0.35, 0.1, np.arange(100.0)
    tone = np.exp(2j * np.pi * f * t)
    part = derivatives.held_command(tone.real, 1.0, delay, hold)
    held = tone * np.sinc(f * hold) * np.exp(-2j * np.pi * f * delay)
    inner = slice(derivatives.HALF, -derivatives.HALF)
    assert np.abs(part[:, 0] - held.real[inner]).max() < 1e-6


@pytest.mark.parametrize(("fs", "factor"), [(10.0, 10), (5.0, 5), (2.5, 2), (2.0, 2), (1.0, 1), (0.5, 1)])
def test_low_pass_keeps_the_band_and_removes_what_would_alias(fs, factor):
    taps, found = derivatives.low_pass(fs)
    assert found == factor
    band = np.linspace(0, derivatives.F_MAX, 50)
    assert np.abs(response(taps, band / fs) - 1).max() < 3e-5
    for alias in range(1, factor):
        near = alias * fs / factor + np.linspace(-derivatives.F_MAX, derivatives.F_MAX, 50)
        assert np.abs(response(taps, near / fs)).max() < 2e-5


def test_short_gaps_are_bridged_and_long_ones_masked():
    t = np.arange(3000) / 10
    x = np.sin(2 * np.pi * 0.0533 * t)
    holed = x.copy()
    for missing in (slice(0, 3), slice(500, 501), slice(800, 810), slice(1500, 1511), slice(2990, 3000)):
        holed[missing] = np.nan
    filled, masked = derivatives.interpolate_gaps(holed, 10.0)
    assert np.flatnonzero(masked).tolist() == list(range(1500, 1511))
    assert np.abs(filled - x)[3:2990][~masked[3:2990]].max() < 1e-4
    assert np.isfinite(filled).all()


def test_window_is_flat_tapered_and_notched():
    valid = np.ones(10000, dtype=bool)
    w = windowing.window(valid, 1.0)
    assert w[600:-600].min() == 1
    assert w[0] < 1e-5
    assert w[-1] < 1e-5
    valid[5000:5040] = False
    notched = windowing.window(valid, 1.0)
    assert not notched[5000:5040].any()
    assert np.array_equal(notched[:4900], w[:4900])
    assert np.abs(np.diff(notched)).max() < 0.03  # smooth, so that nothing leaks far


def test_sums_over_bins_under_a_hann_window_scatter_as_theory_has_it():
    # mean of w^4 over the square of that of w^2
    assert windowing.variance_factor(np.hanning(10001)) == pytest.approx(35 / 18, rel=1e-3)


@pytest.mark.stat
def test_the_spectrum_of_white_noise_is_its_one_sided_psd():
    # 1000 bins; false-positive probability below 1e-5
    fs, x = 2.0, np.random.default_rng(5).standard_normal((20000, 1))
    spectra = windowing.transform(x, np.ones(len(x), dtype=bool), fs)
    assert np.mean(np.abs(spectra.columns) ** 2) == pytest.approx(2 / fs, rel=0.15)


def test_a_sum_of_columns_is_whitened_as_its_columns_are():
    run = windowing.transform(np.random.default_rng(3).standard_normal((1000, 4)), np.ones(1000, bool), 1.0)
    S, c = 1 + run.f, np.array([1.0, -2.0, 3.0])
    (total, left), (each, of_all) = whitened_run.whiten(run.summed(c), S), whitened_run.whiten(run, S)
    assert np.allclose(total[:, 0], each[:, :3] @ c, rtol=1e-12, atol=1e-12)
    assert np.array_equal(left, of_all)
    assert np.sum(1 - left) == pytest.approx(2 / 2)  # constant and ramp, of two numbers in every bin


def shape(f):
    """PSD of a Delta g with its tail, plateau, read-out noise and a jitter bump at 50 mHz."""
    bump = 12e-15 * np.exp(-0.5 * (np.log(f / 0.05) / 0.35) ** 2)
    return (60e-15 * 2e-5 / f) ** 2 + 4e-15**2 + bump**2 + (35e-15 * (2 * np.pi * f) ** 2) ** 2


@pytest.mark.parametrize("hours", [6, 65])
def test_noise_model_follows_tail_bump_and_rise(hours):
    f = np.arange(1, int(360 * hours) + 1) / (3600 * hours)
    model = fit_noise(f, shape(f), np.ones(f.size))
    assert np.abs(model(f) / shape(f) - 1)[f > 1e-4].max() < 0.05


@pytest.mark.stat
def test_noise_model_is_unbiased_and_knows_its_own_variance():
    # 400 periodograms; false-positive probability below 1e-3 (five standard errors at five frequencies)
    rng = np.random.default_rng(2)
    f = np.arange(1, 2161) / 21600
    models = [fit_noise(f, shape(f) * rng.exponential(size=f.size), np.ones(f.size)) for _ in range(400)]
    at = f[[10, 30, 100, 500, 2000]]
    logs = np.log([model(at) / shape(at) for model in models])
    stated = np.log(models[0].expected(at) / models[0](at))
    assert np.all(np.abs(logs.std(axis=0) ** 2 / stated - 1) < 0.45)
    assert np.all(np.abs(logs.mean(axis=0) + stated / 2) < 5 * np.sqrt(stated / 400) + 0.01)


def test_noise_model_allows_for_what_a_fit_has_taken_out():
    f = np.arange(1, 2161) / 21600
    left = np.where(f < 1e-3, 0.6, 1.0)
    model = fit_noise(f, shape(f) * left, left)
    assert np.abs(model(f) / shape(f) - 1)[f > 1e-4].max() < 0.05


def test_noise_model_goes_on_straight_below_the_first_bin():
    f = np.arange(1, 2161) / 21600
    model = fit_noise(f, 1e-30 * f**-2.0, np.ones(f.size))
    assert model(np.array([1e-6])) / 1e-18 == pytest.approx(1, rel=1e-6)


def test_parts_beside_are_projected_out_together_and_bins_are_those_of_the_band():
    rng = np.random.default_rng(2)
    x, valid = rng.standard_normal((4000, 5)), np.ones(4000, dtype=bool)
    whole = windowing.transform(x[:, :2], valid, 1.0, nuisance=[x[:, 2:]])
    band = whole.band(0.01, 0.03)
    parts = windowing.transform(
        x[:, :2], valid, 1.0, nuisance=(x[:, [i]] for i in (2, 3, 4)), band=(0.01, 0.03)
    )
    assert parts.first == band.first
    for name in ("f", "columns", "nuisance"):
        np.testing.assert_allclose(getattr(parts, name), getattr(band, name), rtol=1e-12)


@pytest.mark.parametrize("n", [2160, 2187, 40])
def test_products_of_slow_series_are_those_of_all_samples(n):
    """Against sums over every sample, with a window that is cut off hard."""
    rng = np.random.default_rng(n)
    last = n // 10
    columns = rng.standard_normal((last, 3)) + 1j * rng.standard_normal((last, 3))
    w = np.where((np.arange(n) > n // 3) & (np.arange(n) < n // 2), 0.0, np.hanning(n))
    all_of_it = np.zeros((n // 2 + 1, 3), dtype=complex)
    all_of_it[1 : last + 1] = columns
    x = np.fft.irfft(all_of_it, n, axis=0) * (w * (n / 2 * np.sqrt(2 / (w @ w))))[:, None]
    z, weights = windowing.product_series(columns, 1, w)
    assert len(z) < 0.5 * n or n < 100
    assert np.allclose(z.T @ (z * weights[:, None]), x.T @ x, rtol=1e-12)


@pytest.mark.parametrize("gap", [0, 150])
def test_a_slow_series_has_the_same_bins_at_few_instants(gap):
    fs, valid = 1.0, np.ones(86400, dtype=bool)
    valid[30000 : 30000 + gap] = False
    t = np.arange(valid.size) / fs
    whole = windowing.transform(np.exp(-(((t - 31000) / 900) ** 2))[:, None], valid, fs, band=(3e-5, 2e-3))
    w, few = windowing.resample_window(whole.window, fs, 0.1)
    assert w.size < valid.size / 9
    there = np.arange(w.size) / few
    x = np.exp(-(((there - 31000) / 900) ** 2))[:, None]
    found = windowing.windowed_spectra(x, w, few, slice(whole.first, whole.first + whole.f.size))
    assert np.abs(found - whole.columns).max() < 1e-5 * np.abs(whole.columns).max()
    assert windowing.resample_window(w, few, 2 * few)[1] == few  # no more than there are
