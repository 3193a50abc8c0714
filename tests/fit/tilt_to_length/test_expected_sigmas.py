"""Expected sigmas of tilt-to-length coefficients, beside those of fits of the oracle's constellation."""

import numpy as np
import pytest

import fit
from fit.tilt_to_length import NAMES, expected_sigmas
from fit.tilt_to_length.expected_sigmas import LINK_ASD
from tests.fit.tilt_to_length.records import TONES, manoeuvre

OMS = 10e-12  # m Hz^-0.5, of the oracle's links


def test_they_are_those_of_a_fit():
    run, noise = manoeuvre(2)
    fitted = fit.calibrate_ttl(run, noise).ttl
    expected = expected_sigmas(run)
    ratio = np.array([fitted[name].sigma / expected[name] for name in NAMES]) * LINK_ASD / OMS
    assert ratio.mean() == pytest.approx(1.0, abs=0.05)
    assert np.abs(ratio - 1).max() < 0.2


def test_without_motion_of_an_assembly_its_sigmas_are_infinite():
    tones = {place: tone for place, tone in TONES.items() if len(place[0]) == 1}
    run, _ = manoeuvre(2, tones=tones, sc_asd=0.0, assembly_asd=0.0, dws=0.0)
    sigmas = expected_sigmas(run)
    assert {name for name in NAMES if np.isfinite(sigmas[name])} == {name for name in NAMES if "eta" in name}
