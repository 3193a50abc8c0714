"""Log-averaged spectra: against known spectra, their own error bars."""

import numpy as np
import pytest
from scipy.signal import lfilter

import fit
from fit.spectra.averaged_spectra import log_psd, log_psds

N = 100_000


def white(seed, size=N):
    return np.random.default_rng(seed).standard_normal(size)


def test_white_noise_and_its_error_bars():
    # Standard deviations over 40 series of ~40 points; chi^2 bounds leave false positives below 1e-6.
    spectra = [log_psd([white(seed, 20_000)], 4.0) for seed in range(40)]
    psd = np.array([s.psd for s in spectra])
    assert psd.mean() == pytest.approx(2 / 4.0, rel=0.02)
    scatter = psd.std(axis=0) / psd.mean(axis=0)
    expected = 1 / np.sqrt(spectra[0].averages)
    assert np.all(np.abs(scatter / expected - 1) < 0.65)
    assert np.mean(scatter / expected) == pytest.approx(1, abs=0.08)
    inside = np.mean([(s.low < 0.5) & (s.high > 0.5) for s in spectra])
    assert inside == pytest.approx(0.683, abs=0.05)
    assert np.all(np.diff(spectra[0].averages) > -0.5)
    f, level, sigma = fit.asd(white(0, 20_000), 4.0)
    assert np.array_equal(f, spectra[0].f) and level**2 == pytest.approx(spectra[0].psd)
    assert sigma / level == pytest.approx(scatter / 2, rel=0.65)  # half of that of the power
    assert np.diff(np.log10(spectra[0].f)) == pytest.approx(0.1)


def test_a_steep_spectrum_is_followed():
    # AR(1) near an integrator: S = 2 / fs / |1 - a z|^2
    a = 0.9999
    noise = [lfilter([1], [1, -a], white(seed)) for seed in range(20)]
    spectrum = log_psd(noise, 1.0)
    true = 2 / np.abs(1 - a * np.exp(-2j * np.pi * spectrum.f)) ** 2
    band = (spectrum.f > 2e-4) & (spectrum.f < 0.2)
    assert spectrum.psd[band] / true[band] == pytest.approx(1, abs=0.12)


def test_lines_and_gaps_change_nothing():
    x = white(1)
    plain = log_psd([x], 1.0)
    lined = log_psd([x + 1e6 + 30 * np.arange(N)], 1.0)
    np.testing.assert_allclose(lined.psd, plain.psd, rtol=1e-4)
    x[49_950:50_050] = np.nan
    gapped = log_psd([x], 1.0)
    assert gapped.f.size < plain.f.size  # where every segment would hold the gap
    same = np.isin(plain.f, gapped.f)
    assert np.all(gapped.averages <= plain.averages[same])
    assert gapped.psd[-10:] == pytest.approx(plain.psd[same][-10:], rel=0.02)


def test_several_quantities_have_the_spectra_of_each():
    runs = [[white(seed, 5000), white(seed + 1, 4000)] for seed in (1, 3)]
    for x in runs[1]:
        x[::700] = np.nan  # no long segment is left
    for found, series in zip(log_psds(runs, 1.0), runs, strict=True):
        alone = log_psd(series, 1.0)
        for name in ("f", "psd", "low", "high", "averages"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))
    assert found.f.size < log_psd(runs[0], 1.0).f.size
