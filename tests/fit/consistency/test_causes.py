"""What may be wrong with a run, as directions in which its parameters move."""

import numpy as np

from fit.consistency.causes import DIRECTIONS
from fit.model import dynamics


def test_parameters_are_moved_by_name_and_those_that_a_run_has_none_of_are_left_out():
    """A simulated loop has its own parameters, in an order of its own."""
    names = (*reversed(dynamics.PARAMETERS), "SuspensionControl.f_p")
    theta = np.arange(2.0, 2.0 + len(names))
    for direction in DIRECTIONS:
        moved = dict(zip(names, direction.of(theta, names), strict=True))
        assert moved.pop("SuspensionControl.f_p") == 0
        whole = direction.of(theta[-2::-1], dynamics.PARAMETERS)
        assert moved == dict(zip(dynamics.PARAMETERS, whole, strict=True))
        few = direction.of(np.array([theta[names.index("lambda_2")], 7.0]), ("lambda_2",))
        assert list(few) == [moved["lambda_2"], 0]  # what noisy read-outs tell comes after the names
    assert any(direction.of(theta, names).any() for direction in DIRECTIONS)
