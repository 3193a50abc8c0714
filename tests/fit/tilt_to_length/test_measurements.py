"""Files of measurements: written, read back, and refused in one sentence where they are wrong."""

import h5py
import numpy as np
import pytest

from fit.errors import InputError
from fit.tilt_to_length import read_measurements, write_measurements
from fit.tilt_to_length.michelson import LINKS
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


def _delay(file):
    file["d_12"][:] = 8.3e9


def _move(file):
    file["dws_eta_21"][:] += 1e-6 * np.sin(np.arange(file["time"].size) / 10)


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (
            lambda file: file["dws_phi_12"].attrs.update(units="rad"),
            "dws_phi_12: units 'rad', expected 'rad s-1'",
        ),
        (
            lambda file: file["d_12"].write_direct(np.full(file["time"].size, 8.3e9)),
            "expected a light travel",
        ),
        (_move, r"eta_21: moves by .* rad, .*repeat the manoeuvre with a smaller amplitude"),
        (lambda file: file.attrs.update(dws_asd=-1.0), "dws_asd: -1.0, expected a number that is not neg"),
    ],
)
def test_what_is_wrong_is_named(path, damage, sentence):
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(InputError, match=sentence):
        read_measurements(path)


def _empty(file, *names):
    for name in names:
        file[name][:] = np.nan


@pytest.mark.parametrize(
    ("damage", "variables"),
    [
        (lambda file: file.pop("Y2"), ["X2", "Z2"]),
        (lambda file: _empty(file, "X2", "Y2"), ["Z2"]),  # as without the beat note 12
        (lambda file: file["dws_phi_23"].write_direct(np.zeros(file["time"].size)), ["X2"]),
    ],
)
def test_variables_without_data_are_left_out(path, damage, variables):
    with h5py.File(path, "r+") as file:
        damage(file)
    run = read_measurements(path)
    assert list(run.michelson) == variables
    assert {*run.rates} >= {f"phi_{link}" for name in variables for link in LINKS[name]}
    assert run.silent


def test_nothing_without_a_variable(path):
    with h5py.File(path, "r+") as file:
        _empty(file, "X2", "dws_eta_23")
    with pytest.raises(InputError, match=r"without data: X2, dws_eta_23; expected one of X2, Y2, Z2"):
        read_measurements(path)
