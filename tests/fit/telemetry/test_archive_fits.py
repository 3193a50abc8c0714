"""Archives in FITS and in arrays of NumPy, and files that are not what their names say."""

import gzip

import numpy as np
import pytest
from astropy.io import fits

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
    assert_same,
    message,
    read,
    reasons,
    units,
)


def test_numpy(tmp_path):
    np.save(tmp_path / "matrix.npy", OUT)
    np.save(tmp_path / "row.npy", X)
    np.save(tmp_path / "records.npy", np.array([*zip(T, X, strict=True)], [("t", "f8"), ("x", "f4")]))
    np.savez(tmp_path / "set.npz", t=T, out=OUT, utc=WHEN)
    np.savez(tmp_path / "objects.npz", a=np.array([1, "a"], dtype=object), x=X)
    by_number = {str(k + 1): OUT[:, k] for k in range(3)}
    assert_same(read(tmp_path / "matrix.npy"), by_number)
    assert_same(read(tmp_path / "row.npy"), {"1": X})
    assert_same(read(tmp_path / "records.npy"), {"t": T, "x": X.astype("f4")})
    assert_same(
        read(tmp_path / "set.npz"),
        {"t": T, **{f"out[{k}]": values for k, values in by_number.items()}, "utc": STAMPS},
    )
    assert_same(read(tmp_path / "set.npz", "out"), by_number)
    (tmp_path / "cut.npy").write_bytes((tmp_path / "matrix.npy").read_bytes()[:300])
    assert_same(read(tmp_path / "objects.npz"), {"x": X})  # objects of an array cost the others nothing
    assert reasons(tmp_path / "objects.npz") == {"a": "pickled objects"}
    with pytest.raises(InputError, match=r"cut\.npy: cannot be read as arrays of NumPy without"):
        read(tmp_path / "cut.npy")


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
    assert_same(
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
    with open_table(path, "OMS") as archive:
        assert [archive.column(k) for k in (1, 2, 5)] == ["t", "n", "utc"]
    assert message(path, 4) == "column xyz: a matrix, expected one of its columns, xyz[1] to xyz[3]"
    packed = gzip.compress(path.read_bytes())
    (tmp_path / "a.fits.gz").write_bytes(packed)
    assert list(read(tmp_path / "a.fits.gz")) == list(read(path))
    (tmp_path / "a.fits.gz").write_bytes(packed[:-9])
    with pytest.raises(InputError, match=r"a\.fits\.gz: cannot be read as FITS"):
        read(tmp_path / "a.fits.gz")


@pytest.mark.parametrize("null", ["-9999", "***"])
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
    assert_same(read(path), {"t": T, "x": x, "n": n, "label": ["ab"] * N})
    assert units(path) == {"t": "s", "x": "m"}


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
    with pytest.raises(OSError, match="disk is full"), open_table(tmp_path / "a.npy", None):
        raise OSError("the disk is full")
