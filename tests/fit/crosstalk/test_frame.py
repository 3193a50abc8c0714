"""The frame of the telemetry: what is found in either, what becomes of one that is stated wrongly."""

import h5py
import numpy as np
import pytest
from scipy.signal import welch

from fit import deltag
from fit.crosstalk.centrifugal import FRAME
from fit.crosstalk.euler_fit import fit_period
from fit.pipeline import calibrate_inertial
from fit.report import page
from fit.telemetry.reader import read_all
from tests.oracles import rotation_synthetic as synthetic
from tests.oracles.turned import half_turn, stating

DAY = 86400.0
TO_1, TO_2 = "towards test mass 1", "towards test mass 2"
LATE = synthetic.World(plateau=1.74e-15)


def period(*runs):
    return fit_period(runs, synthetic.calibration(LATE).joint)


@pytest.fixture(scope="module")
def half_a_day():
    return synthetic.run(LATE, duration=DAY / 2)


@pytest.fixture(scope="module")
def half_day_fit(half_a_day):
    return period(half_a_day[0])


@pytest.fixture(scope="module")
def refused(half_a_day):
    return calibrate_inertial([half_turn(half_a_day[0])], synthetic.calibration(LATE))


def test_the_centrifugal_term_has_the_coefficient_1(half_day_fit):
    coefficient = half_day_fit.centrifugal
    assert coefficient.value == pytest.approx(1, abs=4.5 * coefficient.sigma)
    assert 0.03 < coefficient.sigma < 0.15
    assert coefficient.unit == "1"
    assert not half_day_fit.unsound


def test_only_delta_eta_changes_sign_in_the_papers_frame(half_a_day, half_day_fit):
    fit = period(stating(half_turn(half_a_day[0]), TO_1))
    assert fit["delta_phi"].value == pytest.approx(half_day_fit["delta_phi"].value, rel=1e-9)
    assert fit["delta_eta"].value == pytest.approx(-half_day_fit["delta_eta"].value, rel=1e-9)
    np.testing.assert_allclose(fit.centrifugal.value, half_day_fit.centrifugal.value, rtol=1e-9)
    sigmas = [[e.sigma for e in f.parameters.values()] for f in (fit, half_day_fit)]
    np.testing.assert_allclose(*sigmas, rtol=1e-9)
    assert fit.warnings == half_day_fit.warnings


@pytest.mark.parametrize(("stated", "true"), [(TO_2, TO_1), (TO_1, TO_2)])
def test_a_frame_that_the_data_contradict_is_refused(half_a_day, refused, stated, true):
    fit = refused.inertial["0"] if stated == TO_2 else period(stating(half_a_day[0], TO_1))
    (warning,) = fit.unsound
    assert (warning.code, warning.parameters) == (FRAME, ("delta_phi", "delta_eta"))
    assert stated in warning.message
    assert f"x_axis = {true!r}" in warning.message
    assert fit.centrifugal.value == pytest.approx(-1, abs=4.5 * fit.centrifugal.sigma)


def test_a_frame_that_is_refused_reaches_no_product(half_a_day, refused, tmp_path):
    assert [place for place, _ in refused.unsound] == ["inertial.0"]
    path = synthetic.write(tmp_path, half_turn(half_a_day[0]), LATE)
    (run,) = read_all([path])
    product = deltag.delta_g(run, refused)
    assert not {"g_Omega", "g_dOmega"} & product.channels.keys()
    assert (
        "g_Omega and g_dOmega are left out: the inertial period 0 is not sound" in product.attributes["notes"]
    )
    html = page.write_report(tmp_path, refused, [run]).read_text()
    assert "The telemetry is not in the frame that it states" in html


def test_the_product_is_as_quiet_in_either_frame(half_a_day, tmp_path):
    """Delta g is the true one, of the other sign."""
    turned = stating(half_turn(half_a_day[0]), TO_1)
    path = synthetic.write(tmp_path, turned, LATE)
    results = calibrate_inertial(read_all([path]), synthetic.calibration(LATE))
    product = tmp_path / "product.h5"
    deltag.write_delta_g(path, product, results, {})
    with h5py.File(product) as file:
        assert file.attrs["x_axis"] == TO_1
        channels = {name: file[name][:] for name in ("delta_g", "delta_g_x", "g_Omega")}

    def level(x):
        f, S = welch(x, 1.0, nperseg=x.size // 3, detrend="linear")
        return np.sqrt(S[(f > 0.06e-3) & (f < 0.3e-3)].mean())

    true = half_a_day[1]["delta_g"][10:-10]
    assert level(channels["delta_g"] + true) < 0.4 * level(true) < 0.2 * level(channels["delta_g_x"])
