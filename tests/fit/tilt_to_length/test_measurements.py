"""Files of measurements: written, read back, and refused in one sentence where they are wrong."""

import h5py
import numpy as np
import pytest

from fit.errors import InputError
from fit.tilt_to_length import read_measurements, write_measurements
from tests.fit.tilt_to_length.records import coefficients, measurements


@pytest.fixture(scope="module")
def run():
    rng = np.random.default_rng(1)
    return measurements(rng, 60.0, coefficients(rng))


@pytest.fixture
def path(run, tmp_path):
    write_measurements(run, tmp_path / "m.h5")
    return tmp_path / "m.h5"


def test_a_file_holds_all_of_the_measurements(run, path):
    again = read_measurements(path)
    assert (again.fs, again.central_frequency, again.dws_asd) == (run.fs, run.central_frequency, run.dws_asd)
    assert again.truth == run.truth
    assert again.delays == pytest.approx(run.delays)
    for name, values in (run.michelson | run.rates).items():
        np.testing.assert_array_equal((again.michelson | again.rates)[name], values)


def _unit(file):
    file["dws_phi_12"].attrs["units"] = "rad"


def _missing(file):
    del file["Y2"]


def _schema(file):
    file.attrs["schema"] = "lisa-measurements/2"


def _nan(file):
    file["X2"][7] = np.nan


def _delay(file):
    file["d_12"][:] = 8.3e9


def _motion(file):
    file["dws_eta_21"][:] += 1e-6 * np.sin(np.arange(file["time"].size) / 10)


def _constant(file):
    file["dws_phi_12"][:] = 0.0


def _step(file):
    file.attrs["dt"] = 0.5


def _noise(file):
    file.attrs["dws_asd"] = -1.0


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (_unit, r"channel dws_phi_12: units 'rad', expected 'rad s-1'"),
        (
            _missing,
            r"channel Y2: missing, expected it in Hz: X2, Y2, Z2 are .* of second generation .* pytdi",
        ),
        (_schema, r"attribute schema: 'lisa-measurements/2', expected 'lisa-measurements/1'"),
        (_nan, r"channel X2: sample 7 is missing, expected all"),
        (_delay, r"d_12: 8.3e\+09 s, expected a light travel time of 1 to 60 s"),
        (_motion, r"eta_21: moves by .* rad, .*repeat the manoeuvre with a smaller amplitude"),
        (_constant, r"phi_12: 0 throughout, expected what .* wavefront sensing of all six assemblies"),
        (_step, r"time: "),
        (_noise, r"attribute dws_asd: -1.0, expected a number that is not negative"),
    ],
)
def test_what_is_wrong_is_named(path, damage, sentence):
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(InputError, match=sentence):
        read_measurements(path)


def test_no_file_and_no_hdf5(tmp_path):
    with pytest.raises(InputError, match="no such file, expected a file of schema 'lisa-measurements/1'"):
        read_measurements(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("X2")
    with pytest.raises(InputError, match="not HDF5"):
        read_measurements(tmp_path / "text.h5")
