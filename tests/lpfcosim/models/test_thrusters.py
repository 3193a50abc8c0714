"""The layout of the thrusters: what nozzles give together, and the noise that forces and torques share."""

import numpy as np
import pytest
from scipy.signal import csd, welch

from lpfcosim.linear import ClosedLoop, response
from lpfcosim.spacecraft import EIGHT_NOZZLES

LEVEL = 0.15e-6


@pytest.fixture(scope="module")
def run(make_run):
    return make_run(spacecraft="lpf", noise={"nozzles": LEVEL}, n_samples=20_000)


def by_hand(thrusts):
    """Add up forces and torques of nozzles 1 m from the axis and 0.25 m above the centre of mass."""
    total = np.zeros(6)
    for thrust, (azimuth, side) in zip(
        thrusts, [(a, s) for a in (30, 85, 210, 265) for s in (-25, 25)], strict=True
    ):
        a, i, up = np.radians([azimuth, azimuth + 180 + side, 20])
        F = thrust * np.array([np.cos(up) * np.cos(i), np.cos(up) * np.sin(i), np.sin(up)])
        r = np.array([np.cos(a), np.sin(a), 0.25])
        total[:3] += F
        total[3:] += (r[1] * F[2] - r[2] * F[1], r[2] * F[0] - r[0] * F[2], r[0] * F[1] - r[1] * F[0])
    return total


def test_what_nozzles_give_together():
    thrusts = np.arange(1.0, 9.0)
    np.testing.assert_allclose(EIGHT_NOZZLES @ thrusts, by_hand(thrusts), rtol=1e-12)


def test_along_x_they_are_as_loud_as_without_a_layout(run):
    s = ClosedLoop(run).linearize()
    shares, psd = response.noise_streams(run, s, np.array([1e-3, 0.05]))
    row = s.inputs.index("F_noise_x_sc")
    assert psd @ shares[row] ** 2 / LEVEL**2 == pytest.approx(np.ones(2))


@pytest.mark.stat
def test_jitter_goes_together_as_the_spectra_say(run):
    """o_1 with o_eta_1, 20 to 100 mHz, in 15 segments that overlap: 5 sigma of a coherence (p = 6e-7)."""
    flown = ClosedLoop(run).simulate()
    names = ("o_1", "o_eta_1")
    f, cross = csd(*(flown[name] for name in names), fs=10, nperseg=2500)
    powers = [welch(flown[name], fs=10, nperseg=2500)[1] for name in names]
    band = (f >= 20e-3) & (f <= 100e-3)
    S = response.cross_spectra(run, names, f[band])
    expected = S[:, 0, 1] / np.sqrt(S[:, 0, 0].real * S[:, 1, 1].real)
    result = (cross / np.sqrt(powers[0] * powers[1]))[band]
    assert np.abs(expected).mean() > 0.5
    assert abs(np.mean(result / expected) - 1) < 5 / np.sqrt(8 * band.sum())
