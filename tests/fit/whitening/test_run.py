"""Spectra of a run at other delays."""

import numpy as np
import pytest

from fit.parameters import DELAYS
from fit.spectra.noise_psd import NoiseModel
from fit.whitening.run import Run
from tests.oracles import thirteen


@pytest.fixture(scope="module")
def telemetry():
    return thirteen.telemetry(thirteen.made("A2", "sysid", seed=3))


def flat(S):
    """Return a model of white noise."""
    knots = np.log([1e-5, 1e-3, 0.1])
    return NoiseModel(knots, np.full(3, np.log(S)), np.zeros((3, 3)))


def test_what_noise_hides_is_not_delayed_anew(telemetry):
    run, later = Run(telemetry), (DELAYS[0], DELAYS[1] + 0.02)
    initial = run.spectra(DELAYS)
    assert run.spectra(later, flat(1e-12)) is initial
    assert run.spectra(later, flat(1e-40)) is not initial


def test_only_the_force_whose_delay_moved_is_delayed_anew(telemetry):
    run, (tau_1, tau_2) = Run(telemetry), DELAYS
    run.spectra(DELAYS)
    spectra = run.spectra((tau_1 + 1e-4, tau_2 + 0.02), flat(1e-40))
    assert spectra.tau == (tau_1, tau_2 + 0.02)
    np.testing.assert_array_equal(spectra.columns, Run(telemetry).spectra(spectra.tau).columns)


def test_what_is_left_out_is_told_by_bins(telemetry):
    # 1e-4 of the noise in the loudest bin, by the term after the linear one
    run, seconds = Run(telemetry), 0.02
    initial = run.spectra(DELAYS)
    left_out = (np.abs(initial.columns[:, 1]) * (2 * np.pi * initial.f * seconds) ** 2 / 2).max()
    later = (DELAYS[0], DELAYS[1] + seconds)
    assert run.spectra(later, flat((1.01e4 * left_out) ** 2)) is initial
    assert run.spectra(later, flat((0.99e4 * left_out) ** 2)) is not initial
