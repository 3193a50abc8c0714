"""The map from joint parameters to those of an experiment where gains and delays deviate."""

import numpy as np
import pytest

from fit.identification.parameters import _with_departures
from fit.parameters import FLIGHT

RATIO = FLIGHT["C_2"].value / FLIGHT["lambda_2"].value


def second_of_two(loop_names, deviating):
    """Return the map of the second of two experiments with deviations, and what it measures of them."""
    return _with_departures(np.eye(len(loop_names)), loop_names, [], deviating, 1, 2)


@pytest.mark.parametrize(
    ("loop_names", "deviating", "along", "entries"),
    [
        (("lambda_2", "C_2"), ["lambda_2"], (), {"lambda_2": 1.0, "C_2": RATIO}),
        # the loop keeps its delay
        (("lambda_2",), ["lambda_2"], (), {"lambda_2": 1.0}),
        # of a gain that the loop holds, force and delay come from what was measured
        (("omega2_2_0",), ["lambda_2"], ("lambda_2", "C_2"), {"lambda_2": 1.0, "C_2": RATIO}),
        (("C_2",), ["lambda_2"], ("lambda_2",), {"lambda_2": 1.0, "C_2": RATIO}),
    ],
)
def test_a_gain_deviates_with_the_delay_of_its_force(loop_names, deviating, along, entries):
    parameter_map, measured_names = second_of_two(loop_names, deviating)
    assert measured_names == along
    of_run = [*loop_names, *along]
    expected = np.zeros((len(of_run), len(loop_names) + 2))
    expected[: len(loop_names), : len(loop_names)] = np.eye(len(loop_names))
    for name, value in entries.items():
        expected[of_run.index(name), -1] = value  # the deviation of the second experiment
    np.testing.assert_array_equal(parameter_map, expected)
