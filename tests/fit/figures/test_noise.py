"""Figures of noise: levels of known spectra, what LISA asks."""

import math

import numpy as np
import pytest

from fit.figures import noise
from fit.figures.noise import BANDS, LOW, PLAIN, NoisePoint
from fit.parameters import ARM, M_TM, PLATEAU, effective_authority, lisa
from fit.spectra.averaged_spectra import Estimator, Level

NOMINAL, LOWEST = ((0.0, 10.4e-12), (2200e-12, 10.4e-12)), ((0.0, 1.5e-12), (50e-12, 1.0e-12))


def points(levels):
    """Points of known power: by authority [N], the ASD in the lower band."""
    runs = []
    for k, (authority, asd) in enumerate(levels):
        level = Level(asd, 0.9 * asd, 1.1 * asd)
        start = np.datetime64(f"201{6 + k % 2}-0{1 + k % 9}-01")
        runs.append(NoisePoint(f"run {k}", start, authority, {PLAIN: level, LOW: level}))
    return runs


def test_what_lisa_asks_at_places_worked_out_by_hand():
    assert lisa(2e-3) == pytest.approx(math.sqrt(2) * 3e-15, rel=0.03)
    assert lisa(1e-4) == pytest.approx(math.sqrt(2 * 17) * 3e-15, rel=1e-6)  # 1 + 4^2
    assert lisa(16e-3) == pytest.approx(math.sqrt(2 * 17) * 3e-15, rel=1e-3)  # 1 + 2^4


def test_the_effective_authority_of_the_flights_settings():
    # relative noise 2e-6 of every electrode: 3.3 fm at nominal authority, 0.15 at the lowest
    assert 2e-6 * effective_authority(NOMINAL) / M_TM == pytest.approx(3.4e-15, rel=0.03)
    assert 2e-6 * effective_authority(LOWEST) / M_TM == pytest.approx(0.2e-15, rel=0.1)
    assert effective_authority(((0.0, ARM), (0.0, 0.0))) == pytest.approx(1.0)


@pytest.mark.stat
def test_the_level_of_white_noise_is_its_asd_and_its_interval_holds_it():
    # 100 runs of 3 h: within the 68.3 % interval 68 of them, 50 or 86 are beyond 3.8 sigma (p = 1.5e-4)
    rng = np.random.default_rng(7)
    estimator = Estimator(np.ones(10_800, dtype=bool), 1.0, 10e-3)
    inside, ratios = 0, []
    for _ in range(100):
        level = estimator.level(3e-15 / math.sqrt(2) * rng.standard_normal(10_800), (1e-3, 10e-3))
        inside += level.low < 3e-15 < level.high
        ratios.append(level.asd / 3e-15)
    assert 50 < inside < 86
    assert np.mean(ratios) == pytest.approx(1, abs=0.02)  # sigma 0.005
    with pytest.raises(ValueError, match="no ordinate between 1e-06"):
        estimator.level(np.zeros(10_800), (1e-6, 2e-6))


def test_levels_stand_beside_flight_and_requirement():
    chart = noise.by_date(points([(1e-9, 5e-15), (2e-9, 2e-15)]))
    plain, low = chart.panels
    by_label = {line.label: line for line in plain.lines}
    assert by_label["flight"].y == pytest.approx([1e15 * flown.asd for flown in PLATEAU])
    assert by_label["noise runs"].y.tolist() == pytest.approx([5.0, 2.0])
    assert by_label["LISA"].y[0] == pytest.approx(1e15 * noise.required(BANDS[PLAIN]))
    assert "flight" not in {line.label for line in low.lines}
    assert len({len(column) for column in chart.columns.values()}) == 1
