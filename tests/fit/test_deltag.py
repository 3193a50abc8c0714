"""The Delta g product: against the truth of an independent simulator, and as a file."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
import xarray
from scipy.signal import welch
from scipy.spatial.transform import Rotation

import fit
from fit import deltag
from fit import results as fit_results
from fit.deltag import write_delta_g
from fit.errors import InputError
from fit.findings import Finding
from fit.results import Fit
from fit.results.estimates import Estimate
from tests.oracles.rotation_synthetic import BASELINE, World, calibration, run, write

DAY = 86400.0
LATE = World(plateau=1.74e-15, tail=40e-15)
PRODUCT = ("delta_g", "delta_g_x", "g_c", "g_Omega", "g_dOmega", "delta_g_SC")


def fit_of(**values):
    sigma = {name: abs(value) / 100 for name, value in values.items()}
    estimates = {name: Estimate(value, sigma[name], "1") for name, value in values.items()}
    return Fit(estimates, np.diag([s**2 for s in sigma.values()]), 1.0, 1, True, ())


def calibrated(world, *, cross_talk=True):
    """Return results with the truth; b_1 and b_2 hold the Euler force as well, as fitted ones do."""
    phi, eta = world.phi.delta, world.eta.delta
    b = {"1": fit_of(b_1=world.b_1 + BASELINE * phi, b_2=world.b_2 - BASELINE * eta)} if cross_talk else {}
    return replace(calibration(world), inertial={"0": fit_of(delta_phi=phi, delta_eta=eta)}, cross_talk=b)


def product(path, out, results):
    notes = write_delta_g(path, out, results, {"calibration_sha256": "abc"})
    with xarray.open_dataset(out, engine="h5netcdf") as file:
        return file.load(), notes


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Two days: the file, its truth, its product."""
    folder = tmp_path_factory.mktemp("deltag")
    telemetry, truth = run(LATE, duration=2 * DAY)
    path = write(folder, telemetry, LATE)
    return path, truth, *product(path, folder / "product.h5", calibrated(LATE))


def test_it_is_telemetry_that_others_read(recorded):
    path, _, file, notes = recorded
    assert notes == ()
    assert set(PRODUCT) <= set(file.data_vars)
    assert file.time.attrs["units"] == "s"
    assert file.delta_g_SC.long_name.endswith("motion, above 3 to 12 mHz, up to 100 mHz")
    assert file.g_dOmega.long_name.endswith("acceleration, below 3 to 12 mHz")
    for channel in file.data_vars.values():
        assert channel.attrs["units"] == "m s-2"
        assert channel.attrs["long_name"]
        assert channel.dtype == np.float64
    with h5py.File(path) as source:
        for name, value in source.attrs.items():
            assert file.attrs[name] == value
    assert file.attrs["calibration_sha256"] == "abc"
    assert file.attrs["notes"] == ""
    np.testing.assert_array_equal(np.diff(file.time), 1.0)


def test_subtraction_does_not_depend_on_the_couplings(recorded, tmp_path):
    path, _, file, _ = recorded
    right = calibrated(LATE)
    couplings = fit_of(b_1=3e-5, b_2=-3e-5)
    provenance = replace(right.provenance, subtraction={"1": right.cross_talk["1"].values})
    results = replace(right, cross_talk={"1": couplings}, provenance=provenance)
    corrected, _ = product(path, tmp_path / "other.h5", results)
    np.testing.assert_array_equal(corrected.delta_g_SC, file.delta_g_SC)


def test_the_terms_add_up(recorded):
    file = recorded[2]
    whole = file.delta_g_x + file.delta_g_SC + file.g_Omega + file.g_dOmega
    np.testing.assert_allclose(whole, file.delta_g, rtol=0, atol=1e-24)
    dynamics = file.ddo_12 - file.g_c + file.omega2_2_o_12 + file.domega2_12_o_1 - file.delta_ifo_ddo_1
    np.testing.assert_allclose(dynamics, file.delta_g_x, rtol=0, atol=1e-24)
    assert float(np.abs(file.g_c).mean()) > 1e-14
    assert all(float(file[name].std()) > 0 for name in PRODUCT)


def level(x, low, high):
    """Return the ASD averaged in power over a band [Hz] at 1 Hz sampling."""
    f, S = welch(x, 1.0, nperseg=x.size // 4, detrend="linear")
    return np.sqrt(S[(f >= low) & (f <= high)].mean())


@pytest.mark.parametrize(
    ("low", "high", "gained", "remainder"),
    [(0.08e-3, 0.2e-3, 1.7, 0.15), (0.2e-3, 2e-3, 1.5, 0.3), (25e-3, 35e-3, 10, 2.0)],
)
def test_delta_g_is_the_true_one(recorded, low, high, gained, remainder):
    _, truth, file, _ = recorded
    true = truth["delta_g"][10:-10]
    assert level(file.delta_g_x.values, low, high) > gained * level(true, low, high)
    assert level(file.delta_g.values - true, low, high) < remainder * level(true, low, high)


def test_cross_talk_that_holds_the_euler_force_adds_no_noise(recorded, tmp_path):
    """Where the test masses follow the spacecraft, b_1 + d delta_phi subtracts nothing but makes noise."""
    path, truth, _, _ = recorded
    file, notes = product(path, tmp_path / "p.h5", replace(calibrated(LATE), inertial={}))
    assert [note for note in notes if "louder" in note] == []
    assert "louder_bands" not in file.attrs
    turning = file.delta_g_x + file.g_Omega
    for low, high in ((0.2e-3, 0.5e-3), (0.5e-3, 1e-3), (1e-3, 2e-3)):
        assert level(file.delta_g.values, low, high) <= 1.01 * level(turning.values, low, high)
    true = truth["delta_g"][10:-10]
    assert level(file.delta_g.values - true, 25e-3, 35e-3) < 2 * level(true, 25e-3, 35e-3)


def test_above_the_fitted_band_read_outs_of_motion_add_no_noise(recorded, tmp_path):
    """Positions are read to 1.8 nm Hz^-1/2: b_3 times their second derivative is louder than Delta g_x."""
    path, rng = tmp_path / "y.h5", np.random.default_rng(8)
    path.write_bytes(recorded[0].read_bytes())
    with h5py.File(path, "a") as file:
        for j in (1, 2):
            noise = 1.8e-9 * np.sqrt(0.5) * rng.standard_normal(file["time"].size)
            channel = file.create_dataset(f"grs_y_{j}", data=noise)
            channel.attrs["units"], channel.attrs["long_name"] = "m", "lateral position"
            channel.dims[0].attach_scale(file["time"])
    right = calibrated(LATE)
    fitted = replace(right, cross_talk={"1": fit_of(**right.cross_talk["1"].values, b_3=1e-4)})
    file, _ = product(path, tmp_path / "p.h5", fitted)
    for low, high in ((0.13, 0.2), (0.2, 0.25), (0.25, 0.4)):
        uncorrected = level(file.delta_g_x.values, low, high)
        assert 1e-4 * (2 * np.pi * high) ** 2 * 1.8e-9 / np.sqrt(2) > uncorrected  # what is not subtracted
        assert level(file.delta_g.values, low, high) < 1.01 * uncorrected
    assert np.all(file.attrs.get("louder_bands", np.zeros((0, 2)))[..., 1] < 0.13)


def test_added_noise_is_reported_with_its_band(recorded, tmp_path):
    wrong = replace(calibrated(LATE), inertial={"0": fit_of(delta_phi=2e-3, delta_eta=1e-3)})
    file, notes = product(recorded[0], tmp_path / "p.h5", wrong)
    (note,) = notes
    assert note.startswith("delta_g is louder than delta_g_x at ")
    assert note in file.attrs["notes"]
    low, high = np.reshape(file.attrs["louder_bands"], (-1, 2))[0]
    assert low < 0.4e-3 < high
    assert level(file.delta_g.values, low, high) > 1.2 * level(file.delta_g_x.values, low, high)


@pytest.mark.slow
def test_stretches_and_gaps_change_nothing(recorded, tmp_path, monkeypatch):
    path = tmp_path / "gaps.h5"
    path.write_bytes(recorded[0].read_bytes())
    with h5py.File(path, "a") as file:
        for name, start, stop in (
            ("o_12", 1_000, 1_001),
            ("N_phi_2", 5_000, 5_001),
            ("f_x_2", 20_000, 20_300),
            ("o_eta_1", 50_000, 50_020),
            ("ast_phi", 80_000, 90_000),
            ("o_1", 100_000, 130_000),
        ):
            file[name][start:stop] = np.nan
    whole, _ = product(path, tmp_path / "whole.h5", calibrated(LATE))
    for outputs in (4_990, 7_001):
        monkeypatch.setattr(deltag, "STRETCH_SAMPLES", outputs)
        pieces, _ = product(path, tmp_path / "pieces.h5", calibrated(LATE))
        for name, channel in whole.data_vars.items():
            scale = float(np.nanmax(np.abs(channel)))
            np.testing.assert_allclose(pieces[name], channel, rtol=0, atol=1e-9 * scale, err_msg=name)
    missing = np.isnan(whole.delta_g)
    assert int(missing.sum()) == 300 + 20 + 30_000 + 3 * 20  # gaps of a sample are interpolated
    assert not np.isnan(whole.g_Omega[19_900:20_400]).any()
    assert np.isnan(whole.g_dOmega[49_995])
    present = ~missing.values
    change = (whole.delta_g - recorded[2].delta_g).values[present]
    assert np.abs(change).max() < 2e-13  # beside the interpolated sample of o_12; of 1e-12


def test_quaternion_instead_of_angles(recorded, tmp_path):
    path = tmp_path / "turned.h5"
    path.write_bytes(recorded[0].read_bytes())
    with h5py.File(path, "a") as file:
        angles = np.stack([np.zeros(file["time"].size), file["ast_eta"][()], file["ast_phi"][()]], axis=1)
        q = (Rotation.from_euler("xyz", [1.0, 0.2, -2.0]) * Rotation.from_rotvec(angles)).as_quat()
        q[:17] = np.nan
        for i in range(4):
            channel = file.create_dataset(f"ast_q_{i + 1}", data=q[:, i])
            channel.attrs["units"] = "1"
            channel.dims[0].attach_scale(file["time"])
        del file["ast_eta"], file["ast_phi"]
    turned, _ = product(path, tmp_path / "p.h5", calibrated(LATE))
    difference = (turned.g_Omega - recorded[2].g_Omega).values
    assert level(difference, 0.05e-3, 2e-3) < 0.02 * level(recorded[2].g_Omega.values, 0.05e-3, 2e-3)


def test_command(recorded, tmp_path, lpfcosim):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a.h5").write_bytes(recorded[0].read_bytes())
    fit_results.write(calibrated(LATE, cross_talk=False), tmp_path / "R.json")
    status, out, err = lpfcosim("deltag", "data", "--calibration", "R.json")
    assert (status, out.strip()) == (0, "data-deltag/a-deltag.h5")
    assert "warning: file a.h5: delta_g_SC is left out" in err
    assert [p.name for p in (tmp_path / "data").iterdir()] == ["a.h5"]
    with xarray.open_dataset("data-deltag/a-deltag.h5", engine="h5netcdf") as file:
        assert file.attrs["source"] == "a.h5"
        assert len(file.attrs["calibration_sha256"]) == 64
        assert file.attrs["lpfcosim_version"]
    assert lpfcosim("deltag", "data", "--calibration", "R.json", "--out", "x", "--quiet") == (0, "", "")
    for arguments, words in (
        (("data/a.h5", "--calibration", "nowhere.json"), "nowhere.json: no such file"),
        (("nowhere.h5", "--calibration", "R.json"), "nowhere.h5: no such file"),
        (("R.json", "--calibration", "R.json"), "R.json: not HDF5"),
        (
            ("data", "data-deltag/../x", "--calibration", "R.json", "--out", "R.json"),
            "R.json: cannot be made in or written to",
        ),
    ):
        status, _, err = lpfcosim("deltag", *arguments)
        (line,) = err.splitlines()
        assert status == 2 and words in line


def test_a_calibration_that_is_not_sound_gives_no_product(recorded, tmp_path, lpfcosim):
    (tmp_path / "a.h5").write_bytes(recorded[0].read_bytes())
    results = calibrated(LATE)
    reason = Finding("contradiction", "E2 contradicts the others")
    unsound = replace(results, joint=replace(results.joint, warnings=(reason,)))
    with pytest.raises(InputError, match=r"not sound \(E2 contradicts"):
        write_delta_g(tmp_path / "a.h5", tmp_path / "g.h5", unsound, {})
    with pytest.raises(InputError, match=r"not sound \(E2 contradicts"):
        fit.calibrate_inertial([], unsound)
    fit_results.write(unsound, tmp_path / "R.json")
    for name in ("deltag", "fit"):
        status, _, err = lpfcosim(name, "a.h5", "--calibration", "R.json", "--out", "g")
        (line,) = err.splitlines()
        assert status == 2
        assert "R.json: joint: is not sound (E2 contradicts the others)" in line
    assert sorted(p.name for p in tmp_path.iterdir()) == ["R.json", "a.h5"]


def test_unsound_parts_of_the_calibration_are_left_out(recorded, tmp_path):
    results = calibrated(LATE)
    reason = Finding("invalid_data", "the star tracker turns the other way")

    def doubted(fits):
        return {name: replace(fit, warnings=(reason,)) for name, fit in fits.items()}

    for part, channel in (("cross_talk", "delta_g_SC"), ("inertial", "g_dOmega")):
        doubtful = replace(results, **{part: doubted(getattr(results, part))})
        file, notes = product(recorded[0], tmp_path / f"{part}.h5", doubtful)
        (note,) = notes
        assert note.startswith(f"{channel} is left out: ")
        assert "is not sound (the star tracker turns the other way)" in note
        assert channel not in file
