"""Archives in HDF5 and netCDF, as h5py, pandas and xarray write them."""

import pickle

import h5py
import numpy as np
import pytest
import xarray

from fit.errors import InputError
from fit.telemetry.archives import open_table
from tests.fit.telemetry.columns import (
    NAN,
    OUT,
    STAMPS,
    WHEN,
    N,
    T,
    X,
    Y,
    assert_same,
    message,
    pandas_file,
    read,
    reasons,
    units,
)


def test_hdf5_of_any_layout(tmp_path):
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
    assert_same(read(tmp_path / "a.h5"), expected)
    assert units(tmp_path / "a.h5") == {"oms.x": "nm", "packed": "pm s^(-2)", "z [nm]": "nm"}
    assert_same(read(tmp_path / "a.h5", "oms"), {"t": T, "x": X.astype("f4")})
    assert_same(read(tmp_path / "a.h5", "/oms"), {"t": T, "x": X.astype("f4")})
    assert_same(read(tmp_path / "a.h5", "rows"), {str(k + 1): OUT[:, k] for k in range(3)})
    with open_table(tmp_path / "a.h5", "records") as archive:
        assert [archive.column(k) for k in (1, "f1", 3)] == ["f0", "f1", "f2"]
    with open_table(tmp_path / "a.h5", None) as archive:
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
    assert_same(read(tmp_path / "a.mat"), expected)


def test_what_in_hdf5_is_no_column(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["cube"], file["complex"], file["scalar"], file["empty"] = np.ones((3, 4, 5)), 1j * T, 1.0, []
        file["link"], file["other"] = h5py.SoftLink("/cube"), h5py.ExternalLink("other.h5", "/x")
        file["text"], file["reference"] = "abc", file["cube"].ref
        file["nothing"] = h5py.Empty("f8")
        file.create_dataset("elsewhere", (N,), "f8", external=[(tmp_path / "x.bin", 0, 8 * N)])
        file.create_dataset("unwritten", (N,), "f8", chunks=(5,))
        file.create_dataset("lists", (2,), h5py.vlen_dtype("f8"))[0] = T
        file.create_dataset("other filter", data=T, chunks=(10,), scaleoffset=3)
        file["wide"] = np.ones((1001, 1002))
        h5py.h5d.create(file.id, b"date", h5py.h5t.UNIX_D32LE, h5py.h5s.create_simple((N,)))
        file["classes"] = T
        file["classes"].attrs["MATLAB_class"] = np.zeros(3)
    assert reasons(tmp_path / "a.h5") == {
        "classes": "of a type that is not read",
        "complex": "complex numbers",
        "cube": "an array of shape (3, 4, 5)",
        "date": "of a type that is not read",
        "elsewhere": "kept in other files",
        "empty": "empty",
        "link": "a link",
        "lists": "objects",
        "nothing": "empty",
        "other": "a link",
        "other filter": "chunks of 10 values through the filters [6], where at most 16777216 values through "
        "each of gzip, lzf, shuffle and fletcher32 at most once are read",
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
        columns = read(path)
        np.testing.assert_array_equal(columns["x"], data["x"])
        np.testing.assert_array_equal(columns["y"], data["y"])
        np.testing.assert_allclose(columns["time"] * {"milliseconds": 1e-3}[units(path)["time"]], T)
        assert units(path)["x"] == "nm"
    (tmp_path / "cut.nc").write_bytes((tmp_path / "old.nc").read_bytes()[:90])
    with pytest.raises(InputError, match=r"cut\.nc: cannot be read as netCDF, expected a whole file"):
        read(tmp_path / "cut.nc")


def test_data_frames_of_pandas(tmp_path):
    pandas_file(tmp_path / "a.h5")
    micro = [stamp[:-3] for stamp in STAMPS]
    frames = read(tmp_path / "a.h5")
    columns = {"t": T, "x": X, "y": Y}
    assert_same(
        frames,
        {
            **{f"by.columns.{name}": values for name, values in {"index": micro, **columns}.items()},
            **{f"fixed.{name}": values for name, values in {"index": STAMPS, **columns}.items()},
            "series.index": 1e9 * T,
            "series.values": Y,
            **{f"table.{name}": values for name, values in {"index": micro, **columns}.items()},
        },
    )
    assert units(tmp_path / "a.h5") == {"series.index": "ns"}
    with open_table(tmp_path / "a.h5", "by/columns") as archive:
        assert archive.column(3) == "x"


def test_data_frames_that_are_compressed_otherwise_are_named(tmp_path):
    pandas_file(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        values = file["fixed/block1_values"][()]
        del file["fixed/block1_values"]
        file.create_dataset("fixed/block1_values", data=values, chunks=(10, 2), scaleoffset=3)
        file["fixed/block1_values"].attrs["transposed"] = np.uint8(1)
    columns = message(tmp_path / "a.h5", "fixed.t")
    reason = "a data frame of pandas in chunks of 20 values through the filters [6], where at most"
    assert columns.startswith(f'column "fixed.t": fixed is {reason}')


def test_pickles_of_pandas_are_not_unpickled(tmp_path):
    pandas_file(tmp_path / "a.h5")
    trap = b"cos\nsystem\n(V" + f"touch {tmp_path}/ran".encode() + b"\ntR."
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["table/table"].attrs["values_block_0_kind"] = np.bytes_(trap)
        file["table"].attrs["non_index_axes"] = np.bytes_(trap)
    columns = read(tmp_path / "a.h5", "table")
    assert list(columns) == ["index", *(f"values_block_0[{k}]" for k in (1, 2, 3))]
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("labels", "blocks"), [(["t", "b", "1"], [["t", "b", "1"]]), ([2, 1, 0], [[2, 0], [1]])]
)
def test_columns_of_data_frames_that_are_numbers_keep_their_order(tmp_path, labels, blocks):
    fields = [(f"values_block_{i}", "f8", (len(block),)) for i, block in enumerate(blocks)]
    table = np.zeros(N, [("index", "i8"), *fields])
    for (field, *_), block in zip(fields, blocks, strict=True):
        table[field] = [[10 * row + labels.index(label) for label in block] for row in range(N)]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("df")
        group.attrs["pandas_type"] = np.bytes_(b"frame_table")
        group.attrs["non_index_axes"] = np.bytes_(pickle.dumps([(1, labels)], 0))
        group["table"] = table
        for (field, *_), block in zip(fields, blocks, strict=True):
            group["table"].attrs[f"{field}_kind"] = np.bytes_(pickle.dumps(list(block), 0))
    with open_table(tmp_path / "a.h5", "df") as archive:
        assert list(archive.columns) == ["index", *map(str, labels)]
        for k, label in enumerate(labels):
            assert archive.column(k + 2) == str(label)
            values = archive.numbers(str(label))
            np.testing.assert_array_equal(values, 10 * np.arange(N) + k)


@pytest.mark.parametrize(
    ("attributes", "members"),
    [
        ({"pandas_type": np.bytes_(b"frame"), "nblocks": "many"}, {"x": T}),
        ({"pandas_type": np.bytes_(b"frame"), "nblocks": 1}, {"axis0": 1, "axis1": 2, "block0_items": 3}),
        ({"pandas_type": np.bytes_(b"series")}, {"index": T, "values": T}),
        ({"pandas_type": np.bytes_(b"frame_table")}, {"table": T}),
    ],
    ids=["a word as a count", "scalars as axes", "times in no unit", "a table without fields"],
)
def test_a_group_that_is_no_data_frame_is_one_of_arrays(tmp_path, attributes, members):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("d")
        group.attrs.update(attributes)
        for name, values in members.items():
            group[name] = values
            group[name].attrs["kind"] = np.bytes_(b"datetime64[furlong]")
    assert_same(read(tmp_path / "a.h5"), {f"d.{name}": T for name in members if members[name] is T})


@pytest.mark.parametrize("name", ["_FillValue", "missing_value"])
def test_missing_samples_of_records(tmp_path, name):
    kind = np.dtype([("t", "f8"), ("x", "f4"), ("n", "i4"), ("xyz", "f8", (2,)), ("flag", "S2")])
    records = np.zeros(N, kind)
    records["t"], records["x"], records["n"], records["xyz"] = T, X, range(N), OUT[:, 1:]
    records["x"][7], records["n"][9], records["xyz"][11, 1] = -9999, -9999, -9999
    markers = np.zeros(1, kind)
    markers["t"], markers["x"], markers["n"], markers["xyz"] = 3.5, -9999, 5, [-9999, -9999]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["one"], file["each"] = records, records
        file["one"].attrs[name] = np.float64(-9999)
        file["each"].attrs[name] = markers[["t", "x", "n"]]
    columns = read(tmp_path / "a.h5")
    missing = {k: np.flatnonzero(np.isnan(v)).tolist() for k, v in columns.items() if v.dtype.kind == "f"}
    assert {k: n for k, n in missing.items() if n} == {
        "each.n": [5],
        "each.t": [7],
        "each.x": [7],
        "one.n": [9],
        "one.x": [7],
        "one.xyz[2]": [11],
    }
