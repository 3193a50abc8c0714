"""Archives in HDF5, MATLAB, NumPy, netCDF and FITS, as the libraries of those who make them write them."""

import pickle
import re
import sys

import h5py
import numpy as np
import pandas
import pytest
import xarray
from astropy.io import fits
from astropy.table import MaskedColumn
from astropy.table import Table as AstropyTable
from matio import save_to_mat
from matio.utils import MatlabOpaque
from scipy.io import netcdf_file, savemat
from scipy.io.matlab import MatlabObject

from fit.errors import InputError
from fit.telemetry.archives import look, opened

N = 40
T, X, Y = np.arange(N) / 2, 1e-9 * np.arange(N) ** 2, -3.0 * np.arange(N)
OUT = np.column_stack([T, X, Y])
WHEN = np.datetime64("2016-04-16T14:00:00", "ns") + (1e9 * T).astype("m8[ns]")
STAMPS = [str(each) for each in WHEN]
NAN = float("nan")


def read(path, table=None):
    """All columns of numbers and of texts, by name."""
    look(path, table)
    found = {}
    with opened(path, table) as archive:
        for name, column in archive.columns.items():
            assert (column.size is None or column.text) == bool(column.reason), name
            if column.size is not None:
                rows = archive.texts(name) if column.text else (block for (block,) in archive.blocks([name]))
                found[name] = np.array([value for block in rows for value in block])
                assert found[name].size == column.size
    return found


def reasons(path):
    with opened(path, None) as archive:
        return {name: column.reason for name, column in archive.columns.items() if column.size is None}


def units(path):
    with opened(path, None) as archive:
        return {name: column.unit for name, column in archive.columns.items() if column.unit}


def same(found, expected):
    assert list(found) == list(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, name)


def message(path, key, table=None):
    with opened(path, table) as archive, pytest.raises(InputError) as error:
        archive.column(key)
    return str(error.value).removeprefix(f"{path}: ")


def test_hdf5_of_any_layout(tmp_path, monkeypatch):
    monkeypatch.setattr("fit.telemetry.archives.table.BLOCK", 16)
    records = np.array(list(zip(T, X, STAMPS, OUT, strict=True)), "f8, f4, S29, 3f8")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["oms/t"] = T
        file["oms/x"] = X.astype("f4")
        file["oms/x"].attrs["units"] = "nm"
        file["a.b/c"] = X
        file["a/b.c"] = Y
        file.create_dataset("packed", data=Y, chunks=(7,), compression="gzip", shuffle=True)
        file["packed"].attrs["unit"] = np.bytes_(b"[pm s^(-2)]")
        file["out"], file["rows"] = OUT, OUT.T
        file["records"] = records
        file["utc"] = STAMPS
        file["z [nm]"] = Y.reshape(1, N)
    expected = {
        "a.b.c": Y,
        "/a.b/c": X,
        "oms.t": T,
        "oms.x": X.astype("f4"),
        **{f"out[{k + 1}]": OUT[:, k] for k in range(3)},
        "packed": Y,
        "records.f0": T,
        "records.f1": X.astype("f4"),
        "records.f2": STAMPS,
        **{f"records.f3[{k + 1}]": OUT[:, k] for k in range(3)},
        **{f"rows[{k + 1}]": OUT[:, k] for k in range(3)},
        "utc": STAMPS,
        "z [nm]": Y,
    }
    same(read(tmp_path / "a.h5"), expected)
    assert units(tmp_path / "a.h5") == {"oms.x": "nm", "packed": "pm s^(-2)", "z [nm]": "nm"}
    same(read(tmp_path / "a.h5", "oms"), {"t": T, "x": X.astype("f4")})
    same(read(tmp_path / "a.h5", "/oms"), {"t": T, "x": X.astype("f4")})
    same(read(tmp_path / "a.h5", "rows"), {str(k + 1): OUT[:, k] for k in range(3)})
    with opened(tmp_path / "a.h5", "records") as archive:
        assert [archive.column(k) for k in (1, "f1", 3)] == ["f0", "f1", "f2"]
    with opened(tmp_path / "a.h5", None) as archive:
        assert [archive.column(k) for k in ("/oms/t", "z", "a.b.c")] == ["oms.t", "z [nm]", "a.b.c"]
    assert message(tmp_path / "a.h5", "out") == (
        "column out: a matrix, expected one of its columns, out[1] to out[3]"
    )
    assert message(tmp_path / "a.h5", "oms.T").endswith('; did you mean "oms.t"?')
    assert message(tmp_path / "a.h5", 2).startswith("column 2: columns have no order here, expected a name")
    assert message(tmp_path / "a.h5", 4, "records") == (
        "column f3: a matrix, expected one of its columns, f3[1] to f3[3]"
    )
    (tmp_path / "a.mat").write_bytes((tmp_path / "a.h5").read_bytes())
    same(read(tmp_path / "a.mat"), expected)


def test_what_in_hdf5_is_no_column(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["cube"], file["complex"], file["scalar"], file["empty"] = np.ones((3, 4, 5)), 1j * T, 1.0, []
        file["link"], file["other"] = h5py.SoftLink("/cube"), h5py.ExternalLink("other.h5", "/x")
        file["text"], file["reference"] = "abc", file["cube"].ref
        file["nothing"] = h5py.Empty("f8")
        file.create_dataset("elsewhere", (N,), "f8", external=[(tmp_path / "x.bin", 0, 8 * N)])
        file.create_dataset("unwritten", (N,), "f8", chunks=(5,))
        file.create_dataset("lists", (2,), h5py.vlen_dtype("f8"))[0] = T
        file["wide"] = np.ones((1001, 1002))
    assert reasons(tmp_path / "a.h5") == {
        "complex": "complex numbers",
        "cube": "an array of shape (3, 4, 5)",
        "elsewhere": "kept in other files",
        "empty": "empty",
        "link": "a link",
        "lists": "objects",
        "nothing": "empty",
        "other": "a link",
        "reference": "objects",
        "scalar": "a single value",
        "text": "text",
        "unwritten": "declared but never written",
        "wide": "a matrix of shape (1001, 1002)",
    }


def test_missing_samples_and_scale_of_netcdf(tmp_path):
    data = xarray.Dataset(
        {
            "x": ("time", np.where(T == 2, NAN, Y), {"units": "nm"}),
            "y": ("time", np.where(T == 3, NAN, X.astype("f4"))),
        },
        {"time": WHEN},
    )
    packed = {"x": {"dtype": "i2", "scale_factor": 0.5, "add_offset": -40.0, "_FillValue": -999}}
    packed["y"] = {"_FillValue": np.float32(-9999.9)}
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", encoding=packed)
    data.to_netcdf(tmp_path / "old.nc", engine="scipy", format="NETCDF3_CLASSIC", encoding=packed)
    for path in (tmp_path / "a.nc", tmp_path / "old.nc"):
        found = read(path)
        np.testing.assert_array_equal(found["x"], data["x"])
        np.testing.assert_array_equal(found["y"], data["y"])
        np.testing.assert_allclose(found["time"] * {"milliseconds": 1e-3}[units(path)["time"]], T)
        assert units(path)["x"] == "nm"


def test_netcdf_3_of_scipy(tmp_path):
    with netcdf_file(tmp_path / "a.nc", "w") as file:
        file.createDimension("n", N)
        file.createVariable("x", "f8", ("n",))[:] = X
        file.variables["x"].units = "nm"
    same(read(tmp_path / "a.nc"), {"x": X})
    assert units(tmp_path / "a.nc") == {"x": "nm"}
    (tmp_path / "a.nc").write_bytes((tmp_path / "a.nc").read_bytes()[:90])
    with pytest.raises(InputError, match=r"a\.nc: cannot be read as netCDF, expected a whole file"):
        read(tmp_path / "a.nc")


def pandas_file(path):
    """Write what `to_hdf` of pandas 3 writes of a frame with times, in both of its formats."""
    labels = ["t", "x", "y"]
    with h5py.File(path, "w") as file:
        fixed = file.create_group("fixed")
        fixed.attrs.update({"pandas_type": np.bytes_(b"frame"), "nblocks": 2, "ndim": 2})
        fixed["axis0"] = np.array(labels, "S")
        fixed["axis1"] = WHEN.astype("i8")
        fixed["axis1"].attrs["kind"] = np.bytes_(b"datetime64[ns]")
        for i, items in enumerate((["x"], ["t", "y"])):
            fixed[f"block{i}_items"] = np.array(items, "S")
            fixed[f"block{i}_values"] = OUT[:, [labels.index(item) for item in items]]
            fixed[f"block{i}_values"].attrs["transposed"] = np.uint8(1)
        for name, blocks in (("table", [["t", "x", "y"]]), ("by/columns", [["t"], ["x"], ["y"]])):
            group = file.create_group(name)
            group.attrs["pandas_type"] = np.bytes_(b"frame_table")
            group.attrs["non_index_axes"] = np.bytes_(pickle.dumps([(1, labels)], 0))
            group["_i_table/index/sorted"] = np.zeros((3, 4), "i8")
            fields = [f"values_block_{i}" if len(b) > 1 else b[0] for i, b in enumerate(blocks)]
            kind = [
                ("index", "i8"),
                *((f, "f8", (len(b),) if len(b) > 1 else ()) for f, b in zip(fields, blocks, strict=True)),
            ]
            table = np.zeros(N, kind)
            table["index"] = WHEN.astype("M8[us]").astype("i8")
            for field, block in zip(fields, blocks, strict=True):
                table[field] = OUT if len(block) > 1 else OUT[:, labels.index(block[0])]
            group.create_dataset("table", data=table, chunks=(16,), compression="gzip")
            group["table"].attrs["index_kind"] = np.bytes_(b"datetime64[us]")
            for field, block in zip(fields, blocks, strict=True):
                group["table"].attrs[f"{field}_kind"] = np.bytes_(pickle.dumps(block, 0))
        series = file.create_group("series")
        series.attrs["pandas_type"] = np.bytes_(b"series")
        series["index"], series["values"] = (1e9 * T).astype("i8"), Y
        series["index"].attrs["kind"] = np.bytes_(b"timedelta64[ns]")


def test_data_frames_of_pandas(tmp_path):
    pandas_file(tmp_path / "a.h5")
    micro = [stamp[:-3] for stamp in STAMPS]
    found = read(tmp_path / "a.h5")
    columns = {"t": T, "x": X, "y": Y}
    same(
        found,
        {
            **{f"by.columns.{name}": values for name, values in {"index": micro, **columns}.items()},
            **{f"fixed.{name}": values for name, values in {"index": STAMPS, **columns}.items()},
            "series.index": 1e9 * T,
            "series.values": Y,
            **{f"table.{name}": values for name, values in {"index": micro, **columns}.items()},
        },
    )
    assert units(tmp_path / "a.h5") == {"series.index": "ns"}
    with opened(tmp_path / "a.h5", "by/columns") as archive:
        assert archive.column(3) == "x"


def test_pickles_of_pandas_are_not_unpickled(tmp_path):
    pandas_file(tmp_path / "a.h5")
    trap = b"cos\nsystem\n(V" + f"touch {tmp_path}/ran".encode() + b"\ntR."
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["table/table"].attrs["values_block_0_kind"] = np.bytes_(trap)
        file["table"].attrs["non_index_axes"] = np.bytes_(trap)
    found = read(tmp_path / "a.h5", "table")
    assert list(found) == ["index", *(f"values_block_0[{k}]" for k in (1, 2, 3))]
    assert not (tmp_path / "ran").exists()


def test_matlab(tmp_path):
    variables = {
        "out": OUT,
        "row": X,
        "label": "of a test",
        "n": 2.0,
        "utc": np.array(STAMPS),
        "flags": np.array(["ok", "bad"], dtype=object),
        "data": {"t": T[:, None], "oms": {"x": X}},
        "runs": [{"x": X}, {"x": Y}],
        "z": 1j * T,
    }
    expected = {
        **{f"out[{k + 1}]": OUT[:, k] for k in range(3)},
        "row": X,
        "utc": STAMPS,
        "flags": ["ok", "bad"],
        "data.t": T,
        "data.oms.x": X,
        "runs[1].x": X,
        "runs[2].x": Y,
    }
    savemat(tmp_path / "a.mat", variables)
    same(read(tmp_path / "a.mat"), expected)
    assert reasons(tmp_path / "a.mat") == {"label": "text", "n": "a single value", "z": "complex numbers"}
    same(read(tmp_path / "a.mat", "data.oms"), {"x": X})
    savemat(tmp_path / "old.mat", {"out": OUT}, format="4")
    same(read(tmp_path / "old.mat"), {f"out[{k + 1}]": OUT[:, k] for k in range(3)})
    with opened(tmp_path / "old.mat", None) as archive:
        assert [archive.column(2), archive.column("out[3]")] == ["out[2]", "out[3]"]
    save_to_mat(tmp_path / "new.mat", {name: variables[name] for name in ("out", "row", "data", "flags")})
    same(
        read(tmp_path / "new.mat"),
        {name: expected[name] for name in sorted(expected, key=str) if not name.startswith(("runs", "utc"))},
    )


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_every_version_of_matlab_gives_the_same(tmp_path, version):
    runs = np.array([[(X, "first"), (Y, "second")]], dtype=[("x", "O"), ("name", "O")])
    cells, mixed = np.empty((1, 2), dtype=object), np.empty((1, 2), dtype=object)
    cells[0, :], mixed[0, :] = [T, X], ["x", X]
    variables = {
        "square": np.arange(9.0).reshape(3, 3),
        "across": OUT.T,
        "runs": runs,
        "z": 1j * T,
        "cells": cells,
        "mixed": mixed,
        "names": np.array([["ab"], ["cde"]], dtype=object),
        "logical": T > 3,
        "label": "of a test",
        "single": X.astype("f4"),
    }
    save_to_mat(tmp_path / "a.mat", variables, version=version)
    found = {name: values for name, values in read(tmp_path / "a.mat").items() if values.size > 1}
    expected = {
        **{f"square[{k + 1}]": np.arange(9.0).reshape(3, 3)[:, k] for k in range(3)},
        **{f"across[{k + 1}]": OUT[:, k] for k in range(3)},
        "runs[1].x": X,
        "runs[2].x": Y,
        "cells[1]": T,
        "cells[2]": X,
        "mixed[2]": X,
        "names": ["ab", "cde"],
        "logical": T > 3,
        "single": X.astype("f4"),
    }
    same(dict(sorted(found.items())), dict(sorted(expected.items())))
    assert reasons(tmp_path / "a.mat")["z"] == "complex numbers"


def test_objects_of_the_first_matlab(tmp_path):
    """An object before `classdef`, as old versions of LTPDA have it, is a struct with the name of a class."""
    fields = np.array([(X[:, None], "m")], dtype=[("y", "O"), ("yunits", "O")])
    savemat(tmp_path / "a.mat", {"a": MatlabObject(fields, "ao")})
    same(read(tmp_path / "a.mat"), {"a.y": X})


OBJECTS = {
    "a.data.xaxis": T,
    "a.data.yaxis": X,
    "spectra[1].y": X,
    "spectra[2].y": Y,
    "nested.n": T,
    "nested.ao.data.xaxis": T,
    "nested.ao.data.yaxis": X,
    "table.x": X,
    "times.Time": STAMPS,
    "times.x": X,
    "times.y": Y,
    "utc": STAMPS,
    "elapsed": np.arange(N),
    "names": ["a", "b"],
}


def matlab_objects(path, version):
    """Write objects as MATLAB does: of its own classes, and of LTPDA's `ao`."""
    series = MatlabOpaque({"xaxis": T[:, None], "yaxis": X[:, None]}, "tsdata")
    spectra = [MatlabOpaque({"y": values[:, None]}, "ao") for values in (X, Y)]
    ao = MatlabOpaque({"name": "a", "data": series}, "ao")
    variables = {
        "a": ao,
        "spectra": np.array(spectra, dtype=object),
        "nested": {"n": T, "ao": ao},
        "table": pandas.DataFrame({"x": X}),
        "times": pandas.DataFrame({"x": X, "y": Y}, index=pandas.DatetimeIndex(WHEN, name="Time")),
        "utc": WHEN[:, None],
        "elapsed": np.arange(N).astype("m8[s]")[:, None],
        "names": np.array(["a", "b"], dtype=object),
    }
    save_to_mat(path, variables, version=version)


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_objects_of_matlab_and_ltpda(tmp_path, version):
    path = tmp_path / "a.mat"
    matlab_objects(path, version)
    found = {name: values for name, values in read(path).items() if values.size > 1}
    same(dict(sorted(found.items())), dict(sorted(OBJECTS.items())))
    assert reasons(path)["a"] == "an object of class ao with the columns a.data.xaxis, a.data.yaxis"
    assert reasons(path)["times"] == (
        "an object of class timetable with the columns times.Time, times.x, times.y"
    )
    same(read(path, "nested.ao.data"), {"xaxis": T, "yaxis": X})
    with opened(path, "times") as archive:
        assert archive.column(2) == "x"


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_objects_without_mat_io_are_named(tmp_path, monkeypatch, version):
    monkeypatch.setitem(sys.modules, "matio", None)
    save_to_mat(tmp_path / "a.mat", {"a": MatlabOpaque({"y": X[:, None]}, "ao"), "x": X}, version=version)
    why = "which is read with the extra lpfcosim[matlab] alone; save it from MATLAB as a struct"
    assert reasons(tmp_path / "a.mat") == {"a": f"an object of class ao, {why}"}
    same(read(tmp_path / "a.mat"), {"x": X})


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_objects_that_nobody_can_read_are_named(tmp_path, version):
    path = tmp_path / "a.mat"
    save_to_mat(path, {"a": MatlabOpaque({"name": "of a test"}, "plist")}, version=version)
    assert reasons(path)["a"] == ("an object of class plist without numbers; save it from MATLAB as a struct")


def test_numpy(tmp_path):
    np.save(tmp_path / "matrix.npy", OUT)
    np.save(tmp_path / "row.npy", X)
    np.save(tmp_path / "records.npy", np.array([*zip(T, X, strict=True)], [("t", "f8"), ("x", "f4")]))
    np.savez(tmp_path / "set.npz", t=T, out=OUT, utc=WHEN)
    np.savez_compressed(tmp_path / "objects.npz", a=np.array([1, "a"], dtype=object))
    by_number = {str(k + 1): OUT[:, k] for k in range(3)}
    same(read(tmp_path / "matrix.npy"), by_number)
    same(read(tmp_path / "row.npy"), {"1": X})
    same(read(tmp_path / "records.npy"), {"t": T, "x": X.astype("f4")})
    same(
        read(tmp_path / "set.npz"),
        {"t": T, **{f"out[{k}]": values for k, values in by_number.items()}, "utc": STAMPS},
    )
    same(read(tmp_path / "set.npz", "out"), by_number)
    (tmp_path / "cut.npy").write_bytes((tmp_path / "matrix.npy").read_bytes()[:300])
    for name in ("objects.npz", "cut.npy"):
        with pytest.raises(InputError, match=f"{re.escape(name)}: cannot be read as arrays of NumPy without"):
            read(tmp_path / name)


def test_binary_tables_of_fits(tmp_path):
    integers = np.arange(N, dtype="i4")
    integers[5] = -99
    columns = [
        fits.Column("t", "D", unit="s", array=T),
        fits.Column("n", "J", unit="nm", null=-99, array=integers),
        fits.Column("u", "J", bzero=2**31, array=np.arange(N).astype("u4")),
        fits.Column("xyz", "3E", array=OUT),
        fits.Column("utc", "30A", array=STAMPS),
        fits.Column("cube", "4D", dim="(2,2)", array=np.ones((N, 2, 2))),
        fits.Column("flag", "L", array=T > 3),
        fits.Column("bits", "5X", array=np.ones((N, 5), bool)),
        fits.Column("z", "C", array=1j * T),
        fits.Column("list", "PD()", array=np.array([np.ones(k) for k in range(N)], dtype=object)),
    ]
    path = tmp_path / "a.fits"
    fits.HDUList([fits.PrimaryHDU(), fits.BinTableHDU.from_columns(columns, name="OMS")]).writeto(path)
    fits.setval(path, "TSCAL2", value=0.5, ext=1)
    fits.setval(path, "TZERO2", value=7.0, ext=1)
    same(
        read(path),
        {
            "t": T,
            "n": np.where(integers == -99, NAN, 7 + 0.5 * integers),
            "u": np.arange(N),
            **{f"xyz[{k + 1}]": OUT[:, k].astype("f4") for k in range(3)},
            "utc": STAMPS,
        },
    )
    assert reasons(path) == {
        "cube": f"an array of shape ({N}, 2, 2)",
        "flag": "logical values",
        "bits": "bits",
        "z": "complex numbers",
        "list": "rows of different lengths",
    }
    with opened(path, "OMS") as archive:
        assert [archive.column(k) for k in (1, 2, 5)] == ["t", "n", "utc"]
    assert message(path, 4) == "column xyz: a matrix, expected one of its columns, xyz[1] to xyz[3]"


@pytest.mark.parametrize("null", ["-9999", "***", "N/A", ""])
def test_ascii_tables_of_fits(tmp_path, null):
    """A text or nothing in the place of a number is a missing sample, whatever the format and the scale."""
    path = tmp_path / "a.fits"
    columns = [
        fits.Column("t", "F10.3", unit="s", array=T),
        fits.Column("x", "D25.16", unit="m", array=X),
        fits.Column("n", "I8", array=np.arange(N)),
        fits.Column("label", "A4", array=["ab"] * N),
    ]
    fits.HDUList([fits.PrimaryHDU(), fits.TableHDU.from_columns(columns)]).writeto(path)
    with fits.open(path) as hdus:
        begin, width = hdus.fileinfo(1)["datLoc"], hdus[1].header["NAXIS1"]
        begins = [hdus[1].header[f"TBCOL{k}"] - 1 for k in (2, 3)]
    content = bytearray(path.read_bytes())
    for start, cells, row in zip(begins, (25, 8), (4, 7), strict=True):
        place = begin + row * width + start
        content[place : place + cells] = null.rjust(cells).encode()
    path.write_bytes(content)
    for key, value in (("TNULL2", null), ("TNULL3", null), ("TSCAL3", 0.5), ("TZERO3", 7.0)):
        fits.setval(path, key, value=value, ext=1)
    x, n = X.copy(), 7.0 + 0.5 * np.arange(N)
    x[4] = n[7] = NAN
    same(read(path), {"t": T, "x": x, "n": n, "label": ["ab"] * N})
    assert units(path) == {"t": "s", "x": "m"}


def test_masked_columns_of_astropy(tmp_path):
    mask = T == 2
    table = AstropyTable({"n": MaskedColumn(np.arange(N), mask=mask), "x": MaskedColumn(X, mask=mask)})
    table["x"].unit = "nm"
    table.write(tmp_path / "a.fits")
    same(read(tmp_path / "a.fits"), {"n": np.where(mask, NAN, np.arange(N)), "x": np.where(mask, NAN, X)})
    assert units(tmp_path / "a.fits") == {"x": "nm"}


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *[("a.h5", "HDF5"), ("a.nc", "HDF5"), ("a.mat", "a MATLAB file"), ("a.fits", "FITS")],
        *[("a.npy", "arrays of NumPy"), ("a.npz", "arrays of NumPy"), ("a.csv.gz", "text")],
    ],
)
def test_files_that_are_something_else(tmp_path, name, kind):
    (tmp_path / name).write_bytes(b"\x1f\x8bt,x\n1,2\n" if name.endswith("gz") else b"t,x\n1,2\n")
    with pytest.raises(
        InputError, match=rf"{name}: cannot be read as {kind}.*, expected a whole file of this"
    ):
        read(tmp_path / name)


def test_errors_of_who_uses_a_table_are_theirs(tmp_path):
    np.save(tmp_path / "a.npy", OUT)
    with pytest.raises(OSError, match="disk is full"), opened(tmp_path / "a.npy", None):
        raise OSError("the disk is full")
