"""Telemetry of the Euler fit and a fit of it, made once for all tests of a package."""

import pytest

from tests.fit.crosstalk.euler import DAY, LOW_NOISE, fitted
from tests.oracles.rotation_synthetic import run


@pytest.fixture(scope="package")
def three_days():
    return run()


@pytest.fixture(scope="package")
def three_day_fit(three_days):
    return fitted(three_days[0])


@pytest.fixture(scope="package")
def quiet_day():
    return run(LOW_NOISE, duration=DAY)


@pytest.fixture(scope="package")
def quiet_day_fit(quiet_day):
    return fitted(quiet_day[0], world=LOW_NOISE)
