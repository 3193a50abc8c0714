"""Agreement of simulated channels with those of a reference."""

import numpy as np


def assert_agree(got, expected, tolerance=1e-9, floor=0.0):
    """Assert that channels differ by less than a fraction of their rms, but for a floor of rounding.

    One of the two may have more channels than the other.
    """
    names = got.keys() & expected.keys()
    assert names in (got.keys(), expected.keys())
    for name in names:
        allowed = tolerance * np.sqrt(np.mean(expected[name] ** 2)) + floor
        assert np.abs(got[name] - expected[name]).max() <= allowed, name
