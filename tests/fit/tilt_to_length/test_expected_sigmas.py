"""Expected sigmas of tilt-to-length coefficients, beside those of fits of the oracle's constellation."""

import numpy as np
import pytest

from fit.tilt_to_length import (
    NAMES,
    expected_covariance,
    expected_sigmas,
    filter_duration,
    tone_information,
    usable_frequencies,
)
from fit.tilt_to_length.response import response_spectra
from fit.tilt_to_length.ttl_fit import calibrate_ttl
from tests.fit.tilt_to_length.records import TONES, manoeuvre
from tests.oracles import constellation

OMS = 10e-12  # m Hz^-0.5, of the oracle's links


def test_they_are_those_of_a_fit():
    run, noise = manoeuvre(2)
    fitted = calibrate_ttl(run, noise)
    expected = np.sqrt(np.diag(expected_covariance(run))) * OMS / expected_sigmas.LINK_ASD
    ratio = np.array([fitted[name].sigma for name in NAMES]) / expected
    assert ratio.mean() == pytest.approx(1.0, abs=0.05)
    assert np.abs(ratio - 1).max() < 0.2


def test_information_of_tones_is_that_of_their_series():
    run, _ = manoeuvre(2, sc_asd=0.0, assembly_asd=0.0, dws=0.0)
    whole = np.linalg.inv(expected_covariance(run))
    total = np.zeros_like(whole)
    for (place, angle), (f, amplitude) in TONES.items():
        moved = _angles(place, angle, amplitude)
        total += tone_information(np.array([f]), run.delays, moved)[0]
    # the two assemblies of a spacecraft that move together have information in common
    for i, j in (("12", "13"), ("23", "21"), ("31", "32")):
        f, amplitude = TONES[i, "phi"]
        pair = {f"phi_{i}": amplitude, f"phi_{j}": -amplitude}
        total += tone_information(np.array([f]), run.delays, pair)[0]
        for assembly in (i, j):
            total -= tone_information(np.array([f]), run.delays, {f"phi_{assembly}": amplitude})[0]
    seconds = np.diag(whole) / np.diag(total)
    assert seconds.mean() == pytest.approx(1200.0, rel=0.15)  # less the taper of the window
    assert seconds.std() < 0.08 * seconds.mean()  # tones 1 mHz apart overlap


def _angles(place, angle, amplitude):
    if len(place) == 2:
        return {f"{angle}_{place}": amplitude}
    angles = {}
    for link in (x for x in constellation.LINKS if x[0] == place):
        side = np.deg2rad(30.0 if link in ("12", "23", "31") else -30.0)
        share = {"phi": 1.0, "eta": np.cos(side), "theta": -np.sin(side)}[angle]
        angles[f"{'phi' if angle == 'phi' else 'eta'}_{link}"] = share * amplitude
    return angles


def test_frequencies_near_zeros_of_tdi_are_not_usable():
    f = usable_frequencies(1e-3 * np.arange(1, 100), dict.fromkeys(constellation.LINKS, 8.25))
    assert f.min() >= 8e-3
    assert not np.any(np.abs(f - 1 / (4 * 8.25)) < 2e-3)
    assert 45e-3 in np.round(f, 6)


def test_without_motion_of_an_assembly_no_sigma_is_finite():
    tones = {place: tone for place, tone in TONES.items() if len(place[0]) == 1}
    run, _ = manoeuvre(2, tones=tones, sc_asd=0.0, assembly_asd=0.0, dws=0.0)
    assert not np.isfinite(expected_covariance(run)).any()


def test_delays_and_filters_take_what_the_spectra_lack():
    run, _ = manoeuvre(2, noise_duration=1200.0)
    fitted = 1 / float(np.diff(response_spectra(run).f[:2])[0])  # s, from the spacing of bins
    assert run.duration - fitted == pytest.approx(filter_duration(run.fs, run.delays))
