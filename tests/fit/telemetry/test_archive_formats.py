"""Archives of every format: what was written is read, whatever the layout, and what is unclear is refused."""

import gzip
import re
from contextlib import nullcontext, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import pytest
import xarray
from astropy.io import fits
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from matio import save_to_mat
from matio.utils import MatlabOpaque
from scipy.io import savemat

from fit.errors import InputError
from fit.telemetry.archives import Layout, open_table

N = 40
T, X, Y = np.arange(N) / 2, 1e-9 * np.arange(N) ** 2, -3.0 * np.arange(N)
WHEN = np.datetime64("2016-04-16T14:00:00", "ns") + (1e9 * T).astype("m8[ns]")
STAMPS = [str(stamp) for stamp in WHEN]
NAN = float("nan")

values = st.floats(allow_infinity=False, allow_subnormal=False)
matrices = arrays("f8", array_shapes(min_dims=2, max_dims=2, min_side=2, max_side=6), elements=values)


def read(path, table=None, layout=None, *, skip=True):
    """Return all columns of numbers and of texts, by name; `skip` what is neither."""
    columns = {}
    with open_table(path, table, layout) as archive:
        for name in archive.columns:
            with suppress(InputError) if skip else nullcontext():
                columns[name] = archive.read(name)
    return columns


def units(path, layout=None):
    with open_table(path, None, layout) as archive:
        return {name: archive.unit(name) for name in archive.columns if archive.unit(name)}


def refusal(path, table=None, layout=None):
    with pytest.raises(InputError) as refused:
        read(path, table, layout, skip=False)
    assert str(refused.value).startswith(f"{path}: ") and str(refused.value).isprintable()
    return str(refused.value).removeprefix(f"{path}: ")


def assert_same(columns, expected):
    assert list(columns) == list(expected)
    for name, column in expected.items():
        np.testing.assert_array_equal(columns[name], column, name)


@pytest.fixture(scope="module")
def folder():
    with TemporaryDirectory() as path:
        yield Path(path)


# Text ----------------------------------------------------------------------------------------------------


@given(
    matrix=matrices,
    delimiter=st.sampled_from("\t;, "),
    end=st.sampled_from(["\n", "\r\n"]),
    head=st.sampled_from(["", "{}", "# {}", "Instrument OMS\n\n{}", "{}\n{units}", "# {}\n# {units}"]),
    encoding=st.sampled_from(["utf-8-sig", "utf-16", "latin-1"]),
    decimal=st.sampled_from(".,"),
)
def test_text(folder, matrix, delimiter, end, head, encoding, decimal):
    if decimal == delimiter:
        decimal = "."
    columns = [f"x{k}" for k in range(matrix.shape[1])]
    in_units = delimiter.join(["nm"] * len(columns))
    lines = [head.format(delimiter.join(columns), units=in_units)] if head else []
    lines += [delimiter.join(map(repr, row)).replace(".", decimal) for row in matrix.tolist()]
    path = folder / "a.txt"
    path.write_bytes(end.join([*"\n".join(lines).split("\n"), ""]).encode(encoding))
    names = columns if head else [str(k + 1) for k in range(len(columns))]
    layout = Layout(delimiter=None if head else delimiter, decimal=decimal)
    assert_same(read(path, layout=layout), dict(zip(names, matrix.T, strict=True)))
    assert set(units(path, layout).values()) == ({"nm"} if "units" in head else set())


LAYOUTS = {
    "Fortran": ("t x\n 0.5D+00 1.5D-11\n", {"t": [0.5], "x": [1.5e-11]}),
    "missing": ("t,x\n0,\n1,NaN\n2,NA\n3,#N/A\n4,5\n", {"t": range(5), "x": [NAN] * 4 + [5]}),
    "missing between tabs": ("x\ty\n\t\n1.5\t2\n\t\n", {"x": [NAN, 1.5, NAN], "y": [NAN, 2, NAN]}),
    "a name twice": ("x,t,x\n0,1,2.5\n", {"1": [0], "t": [1], "3": [2.5]}),
    "stamps": (f"t,x\n{STAMPS[0]},0\n", {"t": STAMPS[:1], "x": [0]}),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_of_texts(tmp_path, layout):
    text, expected = LAYOUTS[layout]
    (tmp_path / "a.csv").write_text(text)
    assert_same(read(tmp_path / "a.csv"), {name: list(column) for name, column in expected.items()})


UNCLEAR = {
    "words": ("t,x\n0,1\n1,off\n", "column x: cannot be read ('off' is no number"),
    "more cells": ("t,x\n0,1\n1,2,3\n2,3\n", "cannot be read (the dtype passed requires 2 columns but 3"),
    "two integers or one decimal comma": ("x1 [nm]\n0,5\n,25\n", "line 2: the comma may be a decimal mark"),
    "a missing sample": ("x\n1.5\n\n2.5\n", "line 3: blank in a single column"),
    "zero bytes": ("t,x\n1,2\n\0\n3,4\n5,6\n", "line 3: a zero byte"),
}  # fmt: skip


@pytest.mark.parametrize("fault", UNCLEAR)
def test_unclear_texts_are_refused(tmp_path, fault):
    text, expected = UNCLEAR[fault]
    (tmp_path / "a.csv").write_text(text)
    assert refusal(tmp_path / "a.csv").startswith(expected)


def test_what_a_map_states_of_texts(tmp_path):
    (tmp_path / "a.csv").write_text("0,5\n1,5\n")
    assert_same(read(tmp_path / "a.csv", layout=Layout(delimiter=",")), {"1": [0, 1], "2": [5, 5]})
    assert_same(read(tmp_path / "a.csv", layout=Layout(delimiter=";", decimal=",")), {"1": [0.5, 1.5]})
    (tmp_path / "a.csv").write_text(",0,1\n0,1.5,2.5\n")
    assert_same(
        read(tmp_path / "a.csv", layout=Layout(header=0)), {"1": [NAN, 0], "2": [0, 1.5], "3": [1, 2.5]}
    )
    assert_same(read(tmp_path / "a.csv", layout=Layout(header=1)), {"column 1": [0], "0": [1.5], "1": [2.5]})


# HDF5 ----------------------------------------------------------------------------------------------------


@given(
    matrix=matrices,
    kind=st.sampled_from(["f8", "f4", ">f8"]),
    options=st.sampled_from([{}, {"chunks": True}, {"compression": "gzip", "shuffle": True}]),
)
def test_hdf5(folder, matrix, kind, options):
    matrix = np.where(np.abs(matrix) < 1e30, matrix, 0.5).astype(kind)
    matrix = matrix if matrix.shape[0] >= matrix.shape[1] else matrix.T
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("oms/row", data=matrix[:, 0], **options).attrs["unit"] = "[pm s^(-2)]"
        file.create_dataset("out", data=matrix, **options)
        file.create_dataset("records", data=np.rec.fromarrays(matrix.T[:2], names="a,b"), **options)
    columns = {
        "oms.row": matrix[:, 0],
        **{f"out[{k + 1}]": matrix[:, k] for k in range(matrix.shape[1])},
        **{f"records.{name}": matrix[:, k] for k, name in enumerate("ab")},
    }
    assert_same(read(folder / "a.h5"), columns)
    assert units(folder / "a.h5") == {"oms.row": "pm s^(-2)"}
    assert_same(read(folder / "a.h5", "/oms"), {"row": matrix[:, 0]})
    with open_table(folder / "a.h5", "out") as table:
        np.testing.assert_array_equal(table.read(table.column(2)), matrix[:, 1])
    with open_table(folder / "a.h5", None) as table:
        assert table.column("/oms/row") == "oms.row" and not table.has(2)


def test_what_in_hdf5_is_no_column(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["cube"], file["complex"], file["scalar"], file["empty"] = np.ones((3, 4, 5)), 1j * T, 1.0, []
        file["link"], file["other"] = h5py.SoftLink("/cube"), h5py.ExternalLink("other.h5", "/x")
        file["reference"], file["nothing"] = file["cube"].ref, h5py.Empty("f8")
        file.create_dataset("elsewhere", (N,), "f8", external=[(tmp_path / "x.bin", 0, 8 * N)])
        file.create_dataset("unwritten", (N,), "f8", chunks=(5,))
        file.create_dataset("lists", (2,), h5py.vlen_dtype("f8"))[0] = T
        file["calendar"] = T
        file["calendar"].attrs["calendar"] = "noleap"
        file["records"] = np.zeros(N, "f8, i4")
        file["records"].attrs["_FillValue"] = -9999.0
        h5py.h5d.create(file.id, b"date", h5py.h5t.UNIX_D32LE, h5py.h5s.create_simple((N,)))
        file["a.b/c"], file["a/b.c"] = X, Y
    assert_same(read(tmp_path / "a.h5"), {"a.b.c": Y, "/a.b/c": X})


def test_missing_samples_and_scale_of_netcdf(tmp_path):
    columns = {
        "x": ("time", np.where(T == 2, NAN, Y), {"units": "nm"}),
        "y": ("time", np.where(T == 3, NAN, X.astype("f4"))),
    }
    data = xarray.Dataset(columns, {"time": WHEN})
    packed = {"x": {"dtype": "i2", "scale_factor": 0.5, "add_offset": -40.0, "_FillValue": -999}}
    packed["y"] = {"_FillValue": np.float32(-9999.9)}
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", encoding=packed)
    columns = read(tmp_path / "a.nc")
    np.testing.assert_array_equal(columns["x"], data["x"])
    np.testing.assert_array_equal(columns["y"], data["y"])
    assert units(tmp_path / "a.nc")["x"] == "nm"


# FITS ----------------------------------------------------------------------------------------------------


@given(matrix=matrices, missing=st.sets(st.integers(0, 5)), packed=st.booleans())
def test_fits(folder, matrix, missing, packed):
    n = np.arange(len(matrix))
    integers = np.where(np.isin(n, list(missing)), -99, n).astype("i4")
    texts = [STAMPS[k] for k in n]
    columns = [
        fits.Column("x", "D", unit="m", array=matrix[:, 0]),
        fits.Column("n", "J", unit="nm", null=-99, array=integers),
        fits.Column("utc", "30A", array=texts),
        fits.Column("xy", "2D", array=matrix[:, :2]),
        fits.Column("cube", "4D", dim="(2,2)", array=np.ones((len(n), 2, 2))),
    ]
    path = folder / "a.fits"
    hdus = [fits.PrimaryHDU(), fits.BinTableHDU.from_columns(columns, name="OMS")]
    fits.HDUList(hdus).writeto(path, overwrite=True)
    fits.setval(path, "TSCAL2", value=0.5, ext=1)
    fits.setval(path, "TZERO2", value=7.0, ext=1)
    if packed:
        path = folder / "a.fits.gz"
        path.write_bytes(gzip.compress((folder / "a.fits").read_bytes()))
    numbers = np.where(integers == -99, NAN, 7 + 0.5 * integers)
    expected = {"x": matrix[:, 0], "n": numbers, "utc": texts, "xy[1]": matrix[:, 0], "xy[2]": matrix[:, 1]}
    for table in (None, "oms", 1):
        assert_same(read(path, table), expected)
    assert units(path) == {"x": "m", "n": "nm"}
    assert "no table 'FEE'" in refusal(path, "FEE")
    if packed:
        path.write_bytes(path.read_bytes()[:-9])
        assert "cannot be read" in refusal(path)


def test_ascii_tables_of_fits_in_which_blanks_are_zeros_are_refused(tmp_path):
    table = fits.TableHDU.from_columns([fits.Column("x", "D25.16", unit="m", array=X)], name="OMS")
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(tmp_path / "a.fits")
    assert refusal(tmp_path / "a.fits").startswith("no table, expected a binary table")


# MATLAB --------------------------------------------------------------------------------------------------


@given(matrix=matrices, form=st.sampled_from(["4", "5", "v7", "v7.3"]))
def test_matlab(folder, matrix, form):
    """Matrices, structs in structs, and objects as LTPDA has them."""
    matrix = matrix if matrix.shape[0] >= matrix.shape[1] else matrix.T
    path, row = folder / f"{form}.mat", matrix[:, :1]
    out = {f"out[{k + 1}]": matrix[:, k] for k in range(matrix.shape[1])}
    if form == "4":
        savemat(path, {"out": matrix, "row": row}, format="4")
        expected = {"out": out, "row": {"row": row[:, 0]}}
    elif form == "5":
        savemat(path, {"out": matrix, "oms": {"row": row, "ifo": {"x": row}}, "label": "a test"})
        expected = {"out": out, "oms": {"oms.row": row[:, 0], "oms.ifo.x": row[:, 0]}, "label": None}
    else:
        stamps = WHEN[: len(matrix)]
        series = MatlabOpaque({"y": row, "yunits": "m"}, "tsdata")
        save_to_mat(
            path, {"out": matrix, "a": MatlabOpaque({"data": series}, "ao"), "utc": stamps}, version=form
        )
        expected = {"out": out, "a": {"a.data.y": row[:, 0]}, "utc": {"utc": [str(s) for s in stamps]}}
    columns = read(path)
    for name, members in expected.items():
        found = {k: v for k, v in columns.items() if re.match(rf"{name}\b", k) and v.size > 1}
        assert_same(found, members or {})
    assert_same(read(path, "out"), {name[4:-1]: column for name, column in out.items()})


# Any format ----------------------------------------------------------------------------------------------
