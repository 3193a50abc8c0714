"""Parameters of a run from those of the joint fit."""

import pytest

from fit.model import Sharing, dynamics
from fit.parameters import joint_names
from fit.settings import settings
from tests.oracles.synthetic import World, of_run, telemetry


def test_stiffness_follows_the_authority():
    world, names = World(omega2_1_0=-2.8e-7, omega2_2_0=-5.4e-7, alpha_x_2=-222.0), joint_names([1, 2])
    sharing = Sharing(settings().shared)
    matrix = sharing.matrix(telemetry(world, "E", epoch=2), dynamics.PARAMETERS, names)
    expected = of_run(world, "E", 2)
    values = [expected[name] for name in dynamics.PARAMETERS]
    assert matrix @ [vars(world)[name] for name in names] == pytest.approx(values)
