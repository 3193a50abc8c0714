"""A third spacecraft is one record: the equations of LISA, another geometry and other levels of noise."""

from dataclasses import replace

import numpy as np
import pytest

import fit
from fit import spacecraft
from fit.spacecraft.lisa import LISA, PARAMETERS
from tests.oracles import lisa_loop

#: Telescopes 58 degrees and housings 0.4 m apart are choices; the noise of the read-outs is that of Tang et
#: al. (2025), 10 pm and 10 nm, per root Hz.
WORLD = lisa_loop.World(
    half_opening=np.radians(29), geometry={"d_x": 0.02, "d_y": 0.4}, tmi=1e-11, grs=1e-8, force=3e-15
)
GEOMETRY = {"half_opening": np.radians(29), "d_x": 0.02, "d_y": 0.4}


@pytest.fixture
def taiji(monkeypatch):
    monkeypatch.setitem(spacecraft.SPACECRAFT, "Taiji", replace(LISA, name="Taiji"))


def campaign(**attributes):
    runs = lisa_loop.campaign(WORLD, lisa_loop.sequence(5e-6))
    stated = {"spacecraft": "Taiji", **GEOMETRY, **attributes}
    return [replace(run, attributes={**run.attributes, **stated}) for run in runs]


@pytest.mark.usefixtures("taiji")
def test_it_is_calibrated():
    joint = fit.calibrate(campaign()).joint
    assert tuple(joint.parameters) == PARAMETERS
    assert not joint.unsound
    assert max(abs(e.value - WORLD.truth[name]) / e.sigma for name, e in joint.parameters.items()) < 3.5


@pytest.mark.usefixtures("taiji")
def test_the_geometry_of_lisa_is_not_its_own():
    joint = fit.calibrate(campaign(half_opening=np.pi / 6)).joint
    assert "constraint_contradicted" in {w.code for w in joint.unsound}


def test_a_spacecraft_that_is_not_known_is_refused():
    with pytest.raises(
        fit.InputError, match="attribute spacecraft: 'Taiji' is not known, expected LISA Path"
    ):
        fit.calibrate(campaign())
