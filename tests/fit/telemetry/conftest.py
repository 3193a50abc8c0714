"""Channels of a short run, and a folder for their archive."""

import numpy as np
import pytest

from tests.fit.telemetry.mapped import CHANNELS, Archive, N


@pytest.fixture(scope="module")
def channels():
    rng = np.random.default_rng(41)
    return {name: rng.normal(0.0, 1e-9 if name[0] == "o" else 1e-12, N) for name in CHANNELS}


@pytest.fixture
def archive(tmp_path):
    return Archive(tmp_path)
