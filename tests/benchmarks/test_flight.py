"""The levels of Delta g that the benchmark of the flight compares."""

import numpy as np
import pytest

from tests.benchmarks import flight


def test_levels_are_those_of_stretches_without_glitches():
    rng, fs = np.random.default_rng(0), 1.0
    x = 3e-15 * np.sqrt(fs / 2) * rng.standard_normal(200_000)
    x[50_000:50_100] += 1e-12
    quiet, stretches = flight.level(x, fs, 1e-2, 3600.0, [(50_000.0, 50_100.0)])
    assert quiet == pytest.approx(3e-15, rel=0.03, abs=0)
    assert stretches < flight.level(x, fs, 1e-2, 3600.0, [])[1]
    assert flight.level(x, fs, 1e-3, 7200.0, [])[0] > 2 * quiet
    assert np.isnan(flight.level(x, fs, 1e-4, 40_000.0, [(0.0, 200_000.0)])[0])
