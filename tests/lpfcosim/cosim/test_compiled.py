"""What the compiled engine draws and filters: the bits of NumPy's numbers and of SciPy's filter."""

import ctypes

import numpy as np
import pytest
import scipy

from lpfcosim.cosim import compiled
from lpfcosim.signals import decimation, plain

pytestmark = pytest.mark.fmu

SIZES = (1, 0, 7, 1000, 500_000)  # in whatever blocks


@pytest.fixture(autouse=True)
def anew():
    yield
    compiled._normal.cache_clear()


@pytest.mark.parametrize("seed", range(5))
def test_normal_numbers_have_the_bits_of_numpys(seed):
    """Half a million numbers: some 6,000 outside of their layer, 130 in the tail."""
    generator = np.random.default_rng(seed)
    fill = compiled.drawing(np.random.default_rng(seed))
    assert isinstance(fill, compiled._Drawn)
    for n in SIZES:
        found = np.empty(n)
        assert fill(found, 1.0, 0.0, 0.0) == (found[-1] if n else 0.0)
        assert found.tobytes() == generator.standard_normal(n).tobytes()


def test_a_generator_may_have_drawn_before():
    generator = np.random.default_rng(1)
    generator.standard_normal(1000)
    found = np.empty(1000)
    compiled.drawing(generator)(found, 1.0, 0.0, 0.0)
    assert found.tobytes() == generator.standard_normal(1000).tobytes()


def test_another_kind_of_generator_draws_for_itself():
    found = np.empty(1000)
    compiled.drawing(np.random.Generator(np.random.Philox(1)))(found, 1.0, 0.0, 0.0)
    assert np.array_equal(found, np.random.Generator(np.random.Philox(1)).standard_normal(1000))


class Other:
    """NumPy's library, were it to draw numbers of its own by now, or to show nothing."""

    def __init__(self, normal=None):
        if normal:
            self.random_standard_normal = normal


@pytest.mark.parametrize(
    "library", [Other(), Other(ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p)(lambda _: 1.0))]
)
def test_where_numpy_does_otherwise_it_draws(library, monkeypatch):
    engine = compiled.library()
    compiled._normal.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(compiled.ctypes, "CDLL", lambda _: library)
        fill = compiled.drawing(np.random.default_rng(1))
    assert engine is compiled.library()
    assert not isinstance(fill, compiled._Drawn)
    found = np.empty(1000)
    fill(found, 1.0, 0.0, 0.0)
    assert np.array_equal(found, np.random.default_rng(1).standard_normal(1000))


@pytest.mark.parametrize("way", [compiled.drawing, plain])
@pytest.mark.parametrize("size, rho", [(3.7e-15, 0.0), (3.7e-15, 0.99999), (1.0, -0.5)])
def test_noise_has_the_bits_of_scipys_filter(way, size, rho):
    generator, fill, last = np.random.default_rng(2), way(np.random.default_rng(2)), 0.0
    state = np.zeros(1)
    for n in SIZES:
        x = size * generator.standard_normal(n)
        wanted, state = scipy.signal.lfilter([1.0], [1.0, -rho], x, zi=state) if n else (x, state)
        found = np.empty(n)
        last = fill(found, size, rho, last)
        assert found.tobytes() == wanted.tobytes()


@pytest.mark.parametrize("n", [0, 1, 999])
@pytest.mark.parametrize("factor", [2, 5, 10])
def test_the_low_pass_has_the_bits_of_numpys_and_is_a_convolution(factor, n):
    taps = decimation.taps(factor)
    m = taps.size + factor * n - 1  # up to the last sample that the next output lacks
    x = np.random.default_rng(n).standard_normal((m, decimation.TOGETHER)).cumsum(axis=0)
    found, wanted = np.full((2, n, decimation.TOGETHER), np.nan)
    compiled.low_pass(taps, factor, x, found)
    decimation.plain(taps, factor, x, wanted)
    assert found.tobytes() == wanted.tobytes()
    for y, column in zip(found.T, x.T, strict=True):
        direct = scipy.signal.convolve(column, taps, mode="valid", method="direct")[::factor][:n]
        np.testing.assert_allclose(y, direct, rtol=0, atol=1e-15 * np.abs(column).max())
