"""The time axis of a run that is not held in memory."""

from dataclasses import replace

import numpy as np
import pytest

from fit.telemetry.axis import axis_part
from tests.oracles.synthetic import World, telemetry


@pytest.mark.parametrize(
    "axis",
    [
        np.arange(4000) / 10,
        1234.5 + np.arange(4000) / 10,
        np.arange(4000) / 10 * (1 + 1e-9),  # a clock that is not quite even
        np.cumsum(np.full(4000, 0.1)),
    ],
)
def test_the_time_axis_comes_back_to_the_bit_whole_and_in_parts(axis):
    run = replace(telemetry(World(), "A", "sysid", noisy=False), fs=10.0, time=axis)
    for found in (run, replace(run, kind="noise")):
        assert np.array_equal(found.time, axis)
        assert found.size == axis.size
        assert found.duration == 400.0
        for part in (slice(1), slice(-1, None), slice(7, None, 10), slice(5, 50)):
            assert np.array_equal(found.instants(part), axis[part])


def test_an_even_time_axis_takes_no_memory():
    run = replace(telemetry(World(), "A", "sysid", noisy=False), fs=10.0, time=3.0 + np.arange(4000) / 10)
    assert not any(isinstance(kept, np.ndarray) for kept in vars(run).values())


def test_a_part_of_a_part_of_an_even_axis_is_that_of_the_whole():
    axis = 3.0 + np.arange(4000) / 10
    run = replace(telemetry(World(), "A", "sysid", noisy=False), fs=10.0, time=axis)
    part = run.part(slice(70, -5))
    assert np.array_equal(axis_part(part, slice(11, None))[5:50], axis[70:-5][11:][5:50])
    assert not isinstance(axis_part(part, slice(11, None)), np.ndarray)
