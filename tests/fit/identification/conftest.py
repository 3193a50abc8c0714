"""An experiment of the reference plant and its identification, made once for all tests of a package."""

import pytest

from fit import pipeline
from tests.fit.identification.linear_loop import CHOSEN, TRUTH, identified, recorded_experiment


@pytest.fixture(scope="package")
def flown(make_run):
    """An experiment of 5400 s and its noise run, at 10 Hz, from the reference plant."""
    runs, telemetries = recorded_experiment(make_run, "A", TRUTH, seed=3)
    return runs, telemetries, pipeline.calibrate(telemetries, CHOSEN)


@pytest.fixture(scope="package")
def unconstrained(flown):
    return identified(flown)
