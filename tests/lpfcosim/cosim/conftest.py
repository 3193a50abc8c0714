"""The run that FMUs are tested in."""

import pytest

from lpfcosim.spacecraft import Sine


@pytest.fixture
def run(make_run):
    return make_run(
        n_samples=1200,
        noise={"oms": 35e-15},
        injections=(Sine("guidance_o_12", amplitude=10e-9, frequency=0.01, cycles=1, start=10),),
        dc=4e-12,
    )
