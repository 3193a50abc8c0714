"""What experiments see of the joint parameters where gains and delays depart."""

import numpy as np
import pytest

from fit.fitting import departures
from fit.identification.parameters import _view
from fit.parameters import FLIGHT

RATIO = FLIGHT["C_2"].value / FLIGHT["lambda_2"].value


def view(sought, departing):
    """Return what the second of two experiments sees, of one parameter each besides what departs."""
    return _view(np.eye(len(sought)), sought, [], departing, 1, 2)


@pytest.mark.parametrize(
    ("sought", "departing", "along", "entries"),
    [
        (("lambda_2", "C_2"), ["lambda_2"], (), {"lambda_2": 1.0, "C_2": RATIO}),
        # the loop keeps its delay
        (("lambda_2",), ["lambda_2"], (), {"lambda_2": 1.0}),
        # of a gain that the loop holds, force and delay come from what was measured
        (("omega2_2_0",), ["lambda_2"], ("lambda_2", "C_2"), {"lambda_2": 1.0, "C_2": RATIO}),
        (("C_2",), ["lambda_2"], ("lambda_2",), {"lambda_2": 1.0, "C_2": RATIO}),
    ],
)
def test_a_gain_departs_with_the_delay_of_its_force(sought, departing, along, entries):
    found = view(sought, departing)
    assert found.measured_names == along
    of_run = [*sought, *along]
    expected = np.zeros((len(of_run), len(sought) + 2))
    expected[: len(sought), : len(sought)] = np.eye(len(sought))
    for name, value in entries.items():
        expected[of_run.index(name), -1] = value  # the departure of the second experiment
    np.testing.assert_array_equal(found.parameter_map, expected)


def test_a_delay_that_departs_beside_a_gain_of_the_loop_counts_once():
    found = view(("lambda_2",), ["lambda_2", "C_2"])
    assert found.measured_names == ("C_2",)
    np.testing.assert_array_equal(found.parameter_map, [[1, 0, 1, 0, 0], [0, 0, 0, 0, 1]])


def test_the_map_of_the_fit_is_the_same():
    plain = np.arange(16.0).reshape(8, 2)
    names = ("lambda_1", "C_2")
    found = departures.extend_map(plain, names, 0, 2)
    assert found.shape == (8, 6)
    np.testing.assert_array_equal(found[:, :2], plain)
    more = found[:, 2:]
    assert [int(i) for i in np.flatnonzero(more.any(axis=1))] == [0, 2, 3]
    assert more[2, 0] == pytest.approx(FLIGHT["C_1"].value / FLIGHT["lambda_1"].value)
