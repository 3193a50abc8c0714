"""A damaged file of any kind is read as sound values, or refused in one sentence that names it."""

import gzip
import json
import os
import tomllib

import h5py
import matio
import numpy as np
import pytest
import scipy
import tomlkit
from astropy.io import fits
from hypothesis import given, settings
from hypothesis import strategies as st
from matio.utils import MatlabOpaque

from fit import results, telemetry
from fit import settings as fit_settings
from fit.errors import InputError
from fit.report.page import write_report
from fit.telemetry import conversion, maps
from fit.telemetry.archives import open_table
from fit.telemetry.contract import REQUIRED
from lpfcosim.campaign import loading
from tests import ROOT
from tests.hostile.damage import NUMBERS, TEXTS, check_reader, damaged, restructured
from tests.oracles.contract_file import write_contract_file

pytestmark = pytest.mark.skipif(os.name != "posix", reason="files are read in forked processes")

N = 200
X = 1e-9 * np.arange(N)
SETTINGS = (ROOT / "fit" / "default.toml").read_text(encoding="utf-8")
CAMPAIGN = (ROOT / "campaigns" / "quickstart.toml").read_text(encoding="utf-8")
MAP = """\
schema = "lpf-map/1"
time = { column = "t" }
attributes = { F_max_1 = "0 pN", F_max_2 = "2200 pN", N_max_1 = "10.4 pN m", N_max_2 = "10.4 pN m" }
[[runs]]
file = "a.csv"
run = "A"
experiment = "A"
kind = "noise"
t0 = 2016-04-16T00:00:00Z
alignment_epoch = 1
m_tm = "1.928 kg"
[channels]
o_1 = { column = "o1", unit = "nm" }
o_12 = { column = "o12", unit = "nm" }
f_x_1 = { column = "a1" }
f_x_2 = { column = "a2" }
"""
TABLE = "t,o1,o12,a1,a2\n" + "".join(f"{i},{i % 7}e-3,{i % 5}e-3,0,{i % 3}e-12\n" for i in range(60))
RESULTS = {
    "schema": "lpf-results/1",
    "joint": {
        "parameters": {"C_2": {"value": 0.186, "sigma": 1e-3, "unit": "s"}},
        "names": ["C_2"],
        "covariance": [[1e-6]],
        "chi2": 1.0,
        "dof": 2,
        "converged": True,
        "warnings": [{"code": "indeterminable", "parameters": ["C_1"], "message": "not driven"}],
    },
    "provenance": {"telemetry": ["telemetry/A.h5"]},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("in")


# Telemetry and archives ----------------------------------------------------------------------------------


def write_plain(path):
    write_contract_file(path, samples=N, truth={"lambda_1": 1.07})


def write_packed(path):
    """Write channels with checksums."""
    write_contract_file(path, samples=N)
    with h5py.File(path, "a") as file:
        del file["o_1"]
        file.create_dataset("o_1", data=X, chunks=(64,), compression="gzip", shuffle=True, fletcher32=True)
        file["o_1"].attrs["units"] = "m"


def read_telemetry(path):
    """Read a file as the fit does: whatever was damaged, what is accepted keeps the contract."""
    (run,) = telemetry.read_all([path], trusted=True)
    for name in run.channels:
        assert run.channels[name].shape == run.time.shape, name
    for name in REQUIRED:
        assert np.nanmax(np.abs(run.channels[name])) <= 1e6, name
        assert np.mean(np.isnan(run.channels[name])) <= 0.01, name
    assert np.allclose(np.diff(run.time) * run.fs, 1, atol=2e-3)
    assert "packed" not in path.name or np.array_equal(run.channels["o_1"], X)
    telemetry.read_truth(path)


def write_matlab(path):
    scipy.io.savemat(path, {"OMS": {"o1": X, "x": np.zeros((3, 3))}}, do_compression=True)


def write_ltpda(path):
    series, times = (
        MatlabOpaque({"y": X, "yunits": "m"}, "tsdata"),
        np.datetime64("2016", "ns") + np.arange(9),
    )
    variables = {"a": MatlabOpaque({"data": series}, "ao"), "utc": times}
    matio.save_to_mat(path, variables, version="v7.3" if "v7.3" in path.name else "v7")


def write_fits(path):
    columns = [
        fits.Column("o1", "D", unit="m", array=X),
        fits.Column("n", "J", null=-99, array=np.arange(N)),
    ]
    fits.HDUList([fits.PrimaryHDU(), fits.BinTableHDU.from_columns(columns)]).writeto(path)


def write_hdf5(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("records", data=np.zeros(50, "f8, f4, S3, 2i2"), chunks=(20,), compression="lzf")
        file["utc"], file["packed"] = ["2016-04-16T14:00:00Z"] * 50, np.arange(50, dtype="i2")
        file["packed"].attrs.update({"units": "nm", "_FillValue": np.int16(3), "scale_factor": 0.5})


def write_text(path):
    rows = "".join(f'2016-04-16T14:00:{i:02},{i}.5e-9,"{-i}",\n' for i in range(50))
    text = f"# made by hand\ntime,x [nm],y,\nUTC,nm,1,\n{rows}".encode()
    path.write_bytes(gzip.compress(text) if path.suffix == ".gz" else text)


def read_table(path):
    with open_table(path, None) as table:
        columns = {name: table.read(name) for name in table.columns}
    assert all(column.ndim == 1 for column in columns.values())


FILES = {
    "plain.h5": (write_plain, read_telemetry),
    "packed.h5": (write_packed, read_telemetry),
    "struct.mat": (write_matlab, read_table),
    "ltpda.mat": (write_ltpda, read_table),
    "ltpda-v7.3.mat": (write_ltpda, read_table),
    "table.fits": (write_fits, read_table),
    "archive.h5": (write_hdf5, read_table),
    "table.csv": (write_text, read_table),
    "table.csv.gz": (write_text, read_table),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
@settings(max_examples=50)
@given(data=st.data())
def test_damaged_telemetry_and_archives(folder, name, data):
    (write, read), path = FILES[name], folder / name
    source = folder / f"source-{name}"
    if not source.exists():
        write(source)
        read(source)
    path.write_bytes(data.draw(damaged(source.read_bytes())))
    check_reader(read, path)


ATTRIBUTES = ("schema", "run", "kind", "fs", "t0", "F_max_1", "alignment_epoch", "m_tm", "inertial_period")
KINDS = (
    np.zeros(3), ["a", "b"], h5py.Empty("f8"), 1j, np.bool_(1), np.float32(1), np.array([[1]]), b"\xff\xfe",
    np.zeros((), [("a", "i4")]), "9999-12-31T23:59:59-23:59",
)  # fmt: skip


@pytest.mark.slow
@given(
    place=st.sampled_from([*(("/", name) for name in ATTRIBUTES), ("o_1", "units"), ("time", "units")]),
    value=st.sampled_from([*TEXTS, *NUMBERS, *KINDS]),
)
def test_attributes_of_telemetry_of_any_value(folder, place, value):
    path, (group, name) = folder / "attributes.h5", place
    write_contract_file(path, samples=N)
    with h5py.File(path, "a") as file:
        try:
            file[group].attrs[name] = value
        except (TypeError, ValueError, OverflowError, OSError):
            return  # what HDF5 cannot hold
    check_reader(read_telemetry, path)


# Documents -----------------------------------------------------------------------------------------------


def convert(path):
    (path.parent / "a.csv").write_text(TABLE)
    conversion.convert([path], path.parent / "out", any_gaps=False)
    assert {file.name for file in path.parent.parent.iterdir()} == {"map.toml"}  # what was made lies inside


def rebuild_report(path):
    report = path.with_name("report")
    report.mkdir(exist_ok=True)
    write_report(report, results.load(path), [])


DOCUMENTS = {
    "settings.toml": (SETTINGS, fit_settings.read),
    "campaign.toml": (CAMPAIGN, loading.load),
    "map.toml": (MAP, convert),
    "results.json": (json.dumps(RESULTS), rebuild_report),
}


@pytest.mark.parametrize("name", DOCUMENTS)
@settings(max_examples=40)
@given(data=st.data())
def test_damaged_documents(tmp_path_factory, name, data):
    text, read = DOCUMENTS[name]
    parse, dump = (json.loads, json.dumps) if name.endswith("json") else (tomllib.loads, tomlkit.dumps)
    path = tmp_path_factory.getbasetemp() / name / name
    path.parent.mkdir(parents=True, exist_ok=True)
    documents = restructured(parse(text)).map(lambda document: dump(document).encode("utf-8", "replace"))
    path.write_bytes(data.draw(damaged(text.encode()) | documents))
    check_reader(read, path)


@pytest.mark.parametrize("read", [loading.load, fit_settings.read, maps.load, results.load])
def test_what_has_no_end_is_refused(tmp_path, read):
    deep, pipe = tmp_path / "deep.toml", tmp_path / "pipe.toml"
    deep.write_text("a = " + "[" * 500_000)
    os.mkfifo(pipe)
    for path in (deep, pipe, type(deep)("/dev/zero")):
        with pytest.raises(InputError, match=str(path)):
            read(path)
