"""Archives that are damaged: one sentence names the file wherever a library raises."""

import gzip
import os
import random

import h5py
import matio
import numpy as np
import pytest
import scipy
from astropy.io import fits as astropy
from matio.utils import MatlabOpaque

from fit.telemetry.archives import open_table
from tests.hostile.mutations import damaged, try_all

pytestmark = pytest.mark.slow


def matlab(path):
    scipy.io.savemat(path, {"OMS": {"o1": np.arange(50.0), "x": np.zeros((3, 3))}}, do_compression=True)
    return path


def matlab_7_3(path):
    with h5py.File(path, "w", userblock_size=512) as h5:
        h5.create_dataset("OMS/o1", data=np.arange(50.0), compression="gzip")
    return path


def fits(path):
    columns = [
        astropy.Column("o1", "D", unit="m", array=np.arange(50.0)),
        astropy.Column("n", "A", array=["x"] * 50),
    ]
    astropy.HDUList([astropy.PrimaryHDU(), astropy.BinTableHDU.from_columns(columns)]).writeto(path)
    return path


def ascii_fits(path):
    columns = [
        astropy.Column("o1", "E15.7", unit="m", array=np.arange(50.0)),
        astropy.Column("n", "I5", null="-99", array=np.arange(50)),
    ]
    astropy.HDUList([astropy.PrimaryHDU(), astropy.TableHDU.from_columns(columns)]).writeto(path)
    return path


def matlab_objects(version):
    def write(path):
        series = MatlabOpaque({"y": np.arange(50.0), "yunits": "m"}, "tsdata")
        times = np.datetime64("2016-04-16", "ns") + np.arange(50).astype("m8[s]")
        matio.save_to_mat(
            path, {"a": MatlabOpaque({"data": series}, "ao"), "utc": times, "x": np.eye(3)}, version=version
        )
        return path

    return write


def hdf5(path):
    with h5py.File(path, "w") as h5:
        h5.create_dataset("records", data=np.zeros(50, "f8, f4, S3, 2i2"), chunks=(20,), compression="lzf")
        h5["utc"], h5["packed"] = ["2016-04-16T14:00:00Z"] * 50, np.arange(50, dtype="i2")
        h5["packed"].attrs.update({"units": "nm", "_FillValue": np.int16(3), "scale_factor": 0.5})
    return path


def text(path):
    rows = "".join(f'2016-04-16T14:00:{i:02},{i}.5e-9,"{-i}",\n' for i in range(50))
    path.write_text("# made by hand\ntime,x [nm],y,\nUTC,nm,1,\n" + rows)
    return path


def read_table(path):
    result = {}
    with open_table(path, None) as table:
        for name in table.columns:
            result[name] = table.read(name)
            assert result[name].ndim == 1, name
    # a compressed file has a checksum: it is read as it was, or not at all
    assert not path.name.endswith(".fits.gz") or np.array_equal(result["o1"], np.arange(50.0))


@pytest.mark.skipif(os.name != "posix", reason="children are those of POSIX")
def test_damaged_archives(tmp_path, cases):
    writers = {
        ".mat": [matlab, matlab_7_3, matlab_objects("v7"), matlab_objects("v7.3")],
        ".fits": [fits, ascii_fits],
        ".h5": [hdf5],
        ".csv": [text],
    }
    sources = {
        suffix: [write(tmp_path / f"{i}.source{suffix}").read_bytes() for i, write in enumerate(some)]
        for suffix, some in writers.items()
    }
    sources[".csv.gz"] = [gzip.compress(sources[".csv"][0])]
    sources[".fits.gz"] = [gzip.compress(sources[".fits"][0])]
    total = cases(0.1, 80)
    made = {}
    for n in range(total):
        rng = random.Random(n)
        suffix = rng.choice(list(sources))
        path = tmp_path / f"{n}{suffix}"
        path.write_bytes(damaged(rng.choice(sources[suffix]), rng))
        made[path] = f"archive {n}"
    counts = try_all(made, read_table)
    assert min(counts["sound"], counts["refused"]) > 0
