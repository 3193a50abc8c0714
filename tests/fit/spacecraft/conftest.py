"""One LISA spacecraft, measured and calibrated once for all tests of this folder."""

import pytest

import fit
from tests.oracles import lisa_loop


@pytest.fixture(scope="session")
def campaign():
    """A run with tones of 1 um, and its noise run."""
    return lisa_loop.campaign(lisa_loop.WORLD, lisa_loop.sequence(1e-6))


@pytest.fixture(scope="session")
def calibrated(campaign):
    return fit.calibrate(campaign)
