"""The report's sections on spacecraft motion: tables, figures, and what the figures are drawn from."""

import numpy as np
import pytest

from fit.figures import motion as figures_motion
from fit.pipeline import calibrate_inertial
from fit.report.motion import sections
from fit.telemetry.reader import read_all
from tests.oracles import rotation_synthetic as synthetic

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rotating")
    runs = [
        synthetic.run(seed=k, name=f"night-{k}", duration=2 * 86400.0, inertial_period=3)[0] for k in (1, 2)
    ]
    telemetries = read_all([synthetic.write(folder, run) for run in runs])
    return calibrate_inertial(telemetries, synthetic.calibration()), telemetries


def test_correction_quietens_what_rotation_made(calibration):
    results, telemetries = calibration
    (section,) = [p for p in sections(results, telemetries) if p.anchor == "p3"]
    assert [row.name for row in section.parameters.rows] == ["delta_phi", "delta_eta"]
    assert section.parameters.rows[0].flight.startswith("−3.9")  # Euler fit of the paper, 1e-4 rad
    ratio = float(section.figures[0].caption.split("a factor of ")[1].split()[0])
    assert 1.2 < ratio < 4


def test_gain_of_known_spectra():
    rng = np.random.default_rng(5)
    corrected = rng.standard_normal(200_000)
    spectra = figures_motion.spectra([{"delta_g_x": 2 * corrected, "delta_g": corrected}], 1.0)
    ratio, error = figures_motion.gain(spectra)
    assert ratio == pytest.approx(2)
    assert 0 < error < 1
