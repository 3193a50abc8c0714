"""Noise as the compiled engine draws it: the bits of NumPy's numbers and of SciPy's filter."""

import ctypes

import numpy as np
import pytest

from lpfcosim.cosim import compiled
from lpfcosim.signals import PLAIN

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
    fill = compiled.DRAWING.normals(np.random.default_rng(seed))
    assert isinstance(fill, compiled._Drawn)
    for n in SIZES:
        found = np.empty(n)
        fill(found)
        assert found.tobytes() == generator.standard_normal(n).tobytes()


def test_a_generator_may_have_drawn_before():
    generator = np.random.default_rng(1)
    generator.standard_normal(1000)
    found = np.empty(1000)
    compiled.DRAWING.normals(generator)(found)
    assert found.tobytes() == generator.standard_normal(1000).tobytes()


def test_another_kind_of_generator_draws_for_itself():
    found = np.empty(1000)
    compiled.DRAWING.normals(np.random.Generator(np.random.Philox(1)))(found)
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
        fill = compiled.DRAWING.normals(np.random.default_rng(1))
    assert engine is compiled.library()
    assert not isinstance(fill, compiled._Drawn)
    found = np.empty(1000)
    fill(found)
    assert np.array_equal(found, np.random.default_rng(1).standard_normal(1000))


def test_reddened_noise_has_the_bits_of_scipys():
    rho, last = 0.99999, [0.0, 0.0]
    for n in SIZES:
        x = np.random.default_rng(n).standard_normal(n)
        both = x.copy(), x.copy()
        last = [
            way.redden(y, rho, z) for way, y, z in zip((compiled.DRAWING, PLAIN), both, last, strict=True)
        ]
        assert both[0].tobytes() == both[1].tobytes()
        assert last[0] == last[1]
