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


def campaign():
    runs = lisa_loop.campaign(WORLD, lisa_loop.sequence(5e-6))
    return [replace(run, attributes={"spacecraft": "Taiji", **GEOMETRY}) for run in runs]


def test_it_is_calibrated(monkeypatch):
    monkeypatch.setitem(spacecraft.SPACECRAFT, "Taiji", replace(LISA, name="Taiji"))
    joint = fit.calibrate(campaign()).joint
    assert tuple(joint.parameters) == PARAMETERS
    assert not joint.unsound
    assert lisa_loop.pulls(joint, WORLD).max() < 3.5


def test_a_spacecraft_that_is_not_known_is_refused():
    with pytest.raises(
        fit.InputError, match="attribute spacecraft: 'Taiji' is not known, expected LISA Path"
    ):
        fit.calibrate(campaign())
