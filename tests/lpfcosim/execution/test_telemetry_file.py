"""The telemetry file: what the contract asks of it, its bytes, and what happens when it cannot be written."""

import re

import h5py
import numpy as np
import pytest

from fit.parameters import FLIGHT
from lpfcosim.errors import RunError
from lpfcosim.execution import telemetry_file
from lpfcosim.spacecraft import Sine
from tests.reference_run import simulate_reference

PROVENANCE = {"version": "1.2.3", "campaign_digest": "ab" * 32, "seed": 7}
CHANNELS = {"o_1", "o_12", "f_x_1", "f_x_2", "guidance_o_1", "guidance_o_12", "F_x_sc"}


def write(path, run, channels, provenance):
    with telemetry_file.create(path, run, channels, provenance) as file:
        file.append(channels)


@pytest.fixture(scope="module")
def run(make_run, flight_noise):
    return make_run(
        name="D",
        experiment="D",
        t0="2016-04-16T14:00:00Z",
        n_samples=600,
        noise=flight_noise,
        alignment_epoch=4,
        injections=(Sine("guidance_o_1", 4e-9, 0.1, 4, 5.0),),
    )


@pytest.fixture(scope="module")
def channels(run):
    return simulate_reference(run)


@pytest.fixture
def path(tmp_path, run, channels):
    write(tmp_path / "D.h5", run, channels, PROVENANCE)
    return tmp_path / "D.h5"


def test_root_attributes_are_those_of_the_contract(path, run):
    with h5py.File(path) as file:
        assert dict(file.attrs) == {
            "schema": "lpf-telemetry/1",
            "run": "D",
            "experiment": "D",
            "kind": "sysid",
            "fs": 10.0,
            "t0": "2016-04-16T14:00:00Z",
            "F_max_1": 0.0,
            "F_max_2": 2200e-12,
            "N_max_1": 10.4e-12,
            "N_max_2": 10.4e-12,
            "alignment_epoch": 4,
            "m_tm": 1.928,
            **PROVENANCE,
        }


def test_channels_lie_on_the_dimension_scale_time(path, channels):
    with h5py.File(path) as file:
        assert set(file) == CHANNELS | {"time", "truth"}
        assert file["time"].is_scale
        np.testing.assert_array_equal(file["time"], np.arange(600) / 10)
        for name, values in channels.items():
            assert file[name].dims[0][0] == file["time"]
            assert file[name].attrs["long_name"]
            np.testing.assert_array_equal(file[name], values)
        units = [file[name].attrs["units"] for name in ("time", "o_12", "f_x_2", "F_x_sc")]
    assert units == ["s", "m", "m s-2", "N"]


def test_truth_has_every_parameter_and_those_of_the_run(path):
    with h5py.File(path) as file:
        truth = dict(file["truth"].attrs)
    assert truth.keys() >= FLIGHT.keys()
    assert all(truth[name] == parameter.value for name, parameter in FLIGHT.items())
    assert truth["delta_ifo"] == 1.91e-5
    assert truth["tau_2"] == pytest.approx(0.186 / 1.0776)
    assert truth["omega2_1"] == pytest.approx(-3.99e-7 - 28.2e3 * 10.4e-12)
    assert truth["omega2_2"] == pytest.approx(-4.19e-7 - 317 * 2200e-12 - 27.4e3 * 10.4e-12)
    assert truth["domega2_12"] == truth["omega2_2"] - truth["omega2_1"]


def test_a_disk_that_is_full_at_any_byte_leaves_the_old_file(tmp_path, make_run):
    """A limit on the size of files stands in for the disk: HDF5 must not swallow a write that failed."""
    resource = pytest.importorskip("resource")
    run = make_run(name="D", n_samples=4000)
    generator = np.random.default_rng(1)
    channels = {name: generator.standard_normal(run.n_samples) for name in ("o_1", "o_12", "f_x_1", "f_x_2")}

    def write(path):
        with telemetry_file.create(path, run, channels, PROVENANCE) as file:
            for first in range(0, run.n_samples, 700):
                file.append({name: values[first : first + 700] for name, values in channels.items()})

    write(tmp_path / "whole.h5")
    size = (tmp_path / "whole.h5").stat().st_size
    (tmp_path / "D.h5").write_bytes(b"old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    for limit in [*range(0, size, 2003), size - 1, size + 4096]:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
        try:
            write(tmp_path / "D.h5")
        except RunError as error:
            assert re.fullmatch(r"D: .*D\.h5: cannot be written \([Ff]ile too large\)", str(error))
            assert {p.name for p in tmp_path.iterdir()} == {"whole.h5", "D.h5"}
            assert (tmp_path / "D.h5").read_bytes() == b"old"
        else:
            assert limit > size
            assert (tmp_path / "D.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
