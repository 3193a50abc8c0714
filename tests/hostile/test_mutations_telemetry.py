"""Telemetry that is damaged or hostile: one sentence names the file wherever HDF5 raises."""

import os
import random
from pathlib import Path

import h5py
import numpy as np
import pytest

from fit.telemetry import reader as telemetry
from fit.telemetry.contract import REQUIRED
from tests.hostile.mutations import NUMBERS, TEXTS, damaged, survives, try_all
from tests.oracles.contract_file import write_contract_file

pytestmark = pytest.mark.slow

N = 200
PACKED = {"o_1", "f_x_1"}  # channels that `packed` gives checksums


@pytest.fixture
def file(tmp_path):
    return write_contract_file(tmp_path / "A1.h5", samples=N, truth={"lambda_1": 1.07})


def packed(path):
    """Write a file whose channels are compressed, with old and new structures of HDF5."""
    write_contract_file(path, samples=N)
    with h5py.File(path, "a") as h5:
        for name in sorted(PACKED):
            values = h5[name][()]
            del h5[name]
            h5.create_dataset(
                name, data=values, chunks=(64,), compression="gzip", shuffle=True, fletcher32=True
            )
            h5[name].attrs["units"] = "m" if name == "o_1" else "m s-2"
    return path


def use(path):
    """Read a file as the fit does."""
    (read,) = telemetry.read_all([path], trusted=True)
    for name in read.channels:
        assert read.channels[name].shape == read.time.shape, name
        assert np.isfinite(np.nansum(read.channels[name])), name
    for name in REQUIRED:  # whatever was damaged, what is accepted keeps the contract
        assert np.nanmax(np.abs(read.channels[name])) <= 1e6, name
        assert np.mean(np.isnan(read.channels[name])) <= 0.01, name
    assert np.allclose(np.diff(read.time) * read.fs, 1, atol=2e-3)
    telemetry.read_truth(path)
    return read


def use_packed(source):
    """Return a reader of damaged copies: what HDF5 wrote with a checksum is as in the source, or refused."""
    with h5py.File(source) as h5:
        values = {name: h5[name][()] for name in PACKED}

    def read(path):
        result = use(path)
        for name in PACKED & result.channels.keys():
            assert np.array_equal(result.channels[name], values[name]), f"{path.name}: {name} has changed"
        return result

    return read


@pytest.mark.skipif(os.name != "posix", reason="children are those of POSIX")
def test_damaged_telemetry(tmp_path, cases):
    sources = [
        write_contract_file(tmp_path / "plain.source", samples=N, truth={"lambda_1": 1.07}).read_bytes(),
        packed(tmp_path / "packed.source").read_bytes(),
    ]
    readers = (use, use_packed(tmp_path / "packed.source"))
    total = cases(0.25, 150)
    for first in range(0, total, 100):
        made = {}
        for n in range(first, min(first + 100, total)):
            path = tmp_path / f"{n}.h5"
            path.write_bytes(damaged(sources[n % 2], random.Random(n)))
            made[path] = f"telemetry {n}"
        counts = try_all(made, lambda path: readers[int(path.stem) % 2](path))
        assert min(counts["sound"], counts["refused"]) > 0
        for path in made:
            path.unlink()


def put(h5, name, *arguments, **options):
    """Replace a channel; the units stay."""
    units = h5[name].attrs["units"]
    del h5[name]
    h5.create_dataset(name, *arguments, **options).attrs["units"] = units


def elsewhere(h5):
    values = Path(h5.filename).with_name("elsewhere.bin")
    values.write_bytes(bytes(8 * N))
    put(h5, "o_1", (N,), "f8", external=[(str(values), 0, 8 * N)])


def virtual(h5):
    layout = h5py.VirtualLayout((N,), "f8")
    other = write_contract_file(Path(h5.filename).with_suffix(".other"), samples=N)
    layout[:] = h5py.VirtualSource(str(other), "o_12", (N,))
    del h5["o_1"]
    h5.create_virtual_dataset("o_1", layout)
    h5["o_1"].attrs["units"] = "m"


def sparse(h5):
    """A terabyte of samples of which one chunk was written."""
    for name in ("time", "o_1"):
        if name == "time":
            del h5["time"]
            h5.create_dataset("time", (10**11,), "f8", chunks=(1000,), compression="gzip")
        else:
            put(h5, name, (10**11,), "f8", chunks=(1000,), compression="gzip")
        h5[name][:1000] = np.arange(1000) / 10


def _link(target):
    def change(h5):
        del h5["o_1"]
        h5["o_1"] = target

    return change


FAULTS = {
    "compound": lambda h5: put(h5, "o_1", data=np.zeros(N, [("a", "f8"), ("b", "i4")])),
    "objects": lambda h5: put(h5, "o_1", (N,), h5py.ref_dtype),
    "texts": lambda h5: put(h5, "o_1", data=["x"] * N, dtype=h5py.string_dtype()),
    "half precision": lambda h5: put(h5, "o_1", data=np.full(N, 1e-9, "f2")),
    "not a number": lambda h5: put(h5, "o_1", data=np.full(N, np.nan)),
    "another file": _link(h5py.ExternalLink("/etc/passwd", "/o_1")),
    "another file as a device": _link(h5py.ExternalLink("/dev/zero", "/o_1")),
    "elsewhere": elsewhere,
    "virtual": virtual,
    "sparse": sparse,
    "a terabyte": lambda h5: put(h5, "o_1", (10**12,), "f8"),
    "a huge chunk": lambda h5: put(h5, "o_1", (N,), "f8", maxshape=(None,), chunks=(2**28,)),
    "time backwards": lambda h5: h5["time"].__setitem__(slice(None), -np.arange(N) / 10),
    "time beyond all": lambda h5: h5["time"].__setitem__(slice(None), np.full(N, 1e308)),
    "beyond all": lambda h5: h5["o_1"].__setitem__(slice(None), np.full(N, 1e308)),
}  # fmt: skip
SOUND = {"half precision"}


@pytest.mark.parametrize("fault", FAULTS)
def test_hostile_telemetry(file, fault):
    with h5py.File(file, "a") as h5:
        FAULTS[fault](h5)
    sentence = survives(lambda: telemetry.read_all([file]), file, fault)
    assert (sentence is None) == (fault in SOUND), sentence


ATTRIBUTES = (
    "schema", "run", "experiment", "kind", "fs", "t0", "F_max_1", "alignment_epoch", "m_tm",
    "inertial_period",
)  # fmt: skip


def test_hostile_attributes(tmp_path, cases):
    good = write_contract_file(tmp_path / "good.source", samples=N).read_bytes()
    path = tmp_path / "A1.h5"
    for n in range(cases(0.05, 120)):
        rng = random.Random(n)
        path.write_bytes(good)
        with h5py.File(path, "a") as h5:
            for _ in range(rng.choice((1, 1, 2))):
                holder = rng.choice((h5, h5, h5, h5["o_1"], h5["time"]))
                name = rng.choice(ATTRIBUTES) if holder is h5 else rng.choice(("units", "long_name"))
                value = rng.choice((
                    rng.choice(TEXTS), rng.choice(NUMBERS), np.zeros(3), ["a", "b"], h5py.Empty("f8"),
                    1j, np.bool_(1), np.float32(1), np.array([[1]]), b"\xff\xfe", np.array("x", "S3"),
                    h5["o_1"].ref, np.zeros((), [("a", "i4")]), "9999-12-31T23:59:59-23:59", "0001-01-01",
                ))  # fmt: skip
                try:
                    holder.attrs[name] = value
                except (TypeError, ValueError, OverflowError, OSError):
                    continue  # what HDF5 cannot hold
        sentence = survives(lambda: use(path), path, f"attributes {n}")
        assert sentence is None or str(path) in sentence
