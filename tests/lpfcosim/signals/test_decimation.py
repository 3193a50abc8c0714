"""Telemetry below 10 Hz: what passes, what does not, and that nothing is delayed."""

from itertools import pairwise

import numpy as np
import pytest
import scipy

from lpfcosim.execution import telemetry_file
from lpfcosim.signals import decimation


def thinned(run, values, sizes=(10_000,)):
    starts = np.cumsum([0, *np.resize(sizes, 1 + run.n_samples // min(sizes))])
    blocks = [{"o_1": values[a:b]} for a, b in pairwise(starts) if a < run.n_samples]
    return np.concatenate([b["o_1"] for b in decimation.decimate(run, blocks)])


@pytest.mark.parametrize("rate", [1.0, 2.0, 5.0])
def test_what_is_slow_passes_undelayed(make_run, rate):
    run = make_run(n_samples=30_000, sample_rate=rate)
    grid = decimation.grid(run)
    for f in (0.001, 0.1, 0.2 * rate):
        got = thinned(run, np.sin(2 * np.pi * f * run.time))
        assert got.size == grid.n
        assert np.abs(got - np.sin(2 * np.pi * f * grid.time(0, grid.n))).max() < 2e-6


def test_ten_hertz_stays_as_it_is(make_run):
    run = make_run(n_samples=500)
    x = np.arange(500.0)
    assert np.array_equal(thinned(run, x, (100,)), x)
    assert decimation.grid(run) == decimation.Grid(500, 10.0, 0.0)


def test_file_carries_rate_and_times(make_run, tmp_path):
    import h5py

    run = make_run(n_samples=3000, sample_rate=1.0)
    grid = decimation.grid(run)
    with telemetry_file.create(tmp_path / "run.h5", run, ["o_1"], {}) as recording:
        recording.append({"o_1": np.zeros(grid.n)})
    with h5py.File(tmp_path / "run.h5") as file:
        assert file.attrs["fs"] == 1.0
        assert file["time"][0] == pytest.approx(decimation.taps(10).size // 2 / 10)
        np.testing.assert_allclose(np.diff(file["time"]), 1.0)


@pytest.mark.parametrize("factor", [2, 5, 10])
def test_the_low_pass_has_the_response_that_its_docstring_states(factor):
    taps = decimation.taps(factor)
    np.testing.assert_allclose(taps, taps[::-1], rtol=0, atol=1e-16)
    f, response = scipy.signal.freqz(taps, worN=5000, fs=factor)  # in units of the new rate
    assert np.abs(np.abs(response[f <= 0.2]) - 1).max() < 2e-6
    assert np.abs(response[f >= 0.5]).max() < 2e-6


@pytest.mark.parametrize("size", [345, 2501, 10_262])
@pytest.mark.parametrize("rate", [1.0, 2.0, 5.0])
def test_the_filter_is_a_convolution_whatever_the_blocks(make_run, rate, size):
    run, factor = make_run(n_samples=size, sample_rate=rate), round(10 / rate)
    x = np.random.default_rng(size).standard_normal(size).cumsum()
    expected = scipy.signal.convolve(x, decimation.taps(factor), mode="valid", method="direct")[::factor]
    np.testing.assert_allclose(thinned(run, x, (7, 100, 901)), expected, rtol=0, atol=3e-15 * np.abs(x).max())
