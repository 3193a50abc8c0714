"""Channels are read when they are asked for, from the file as it was first."""

import h5py
import numpy as np
import pytest

from fit.errors import InputError
from fit.telemetry import rows
from fit.telemetry.reader import another_stretch, read, read_stretch
from tests.oracles.contract_file import write_contract_file

N = 200


@pytest.mark.parametrize(
    "form", [{}, {"dtype": ">f8"}, {"dtype": "f4"}, {"chunks": (64,), "compression": "gzip"}]
)
def test_samples_are_the_same_however_they_lie_in_the_file(tmp_path, form):
    path, x = write_contract_file(tmp_path / "plain.h5", samples=N), np.arange(N) / 8
    with h5py.File(path) as plain, h5py.File(tmp_path / "other.h5", "w", userblock_size=512) as other:
        other.attrs.update(plain.attrs)
        for name in plain:
            plain.copy(name, other)
        del other["o_1"]
        other.create_dataset("o_1", data=x, **form).attrs["units"] = "m"
    found = read(tmp_path / "other.h5")
    np.testing.assert_array_equal(found.channels["o_1"], x)
    np.testing.assert_array_equal(found.time, read(path).time)


@pytest.mark.parametrize("chunks", [None, (64,), (N,)])
def test_a_long_channel_is_read_part_by_part_as_it_is_read_whole(tmp_path, monkeypatch, chunks):
    x = np.cumsum(np.ones(N)) / 8
    path = write_contract_file(tmp_path / "A1.h5", samples=N, channels={"o_1": (x, "m")})
    with h5py.File(path, "a") as file:
        attributes = dict(file["o_1"].attrs)
        del file["o_1"]
        file.create_dataset("o_1", data=x, chunks=chunks).attrs["units"] = attributes["units"]
    monkeypatch.setattr(rows, "_WHOLE", 50)
    for begin, end in ((0, None), (20, 170)):
        row, found = read_stretch(path, begin, end).row("o_1"), x[begin:end]
        assert row.size == found.size
        for part in (slice(None), slice(3, 60), slice(100, 10**6), slice(1)):
            assert np.array_equal(row[part], found[part])
        some = read_stretch(path, begin, end).part(slice(10, 120))
        assert np.array_equal(some.channels["o_1"], found[10:120])
        assert np.array_equal(some.time, (begin + np.arange(10, 120)) / 10)
    assert np.array_equal(read(path).row("time")[10:20], np.arange(10, 20) / 10)


@pytest.mark.parametrize("long", [False, True])
@pytest.mark.parametrize("chunks", [None, (64,)])
@pytest.mark.parametrize("how", ["replaced", "in place"])
def test_a_file_that_was_written_again_is_refused(tmp_path, monkeypatch, long, chunks, how):
    """Half of a run from before and half from now would look like one."""
    monkeypatch.setattr(rows, "_WHOLE", 50 if long else N)
    path = write_contract_file(tmp_path / "A1.h5", samples=N, channels={"o_1": (np.arange(N) / 8, "m")})
    with h5py.File(path, "a") as file:
        del file["o_1"]
        file.create_dataset("o_1", data=np.arange(N) / 8, chunks=chunks).attrs["units"] = "m"
    run = read(path)
    part = run.part(slice(10, 120))
    assert np.array_equal(run.row("o_1")[:], np.arange(N) / 8)
    assert np.array_equal(part.channels["o_1"], np.arange(10, 120) / 8)
    if how == "in place":
        with h5py.File(path, "a") as file:
            file["o_1"][3] = 0.5
    else:
        write_contract_file(tmp_path / "other.h5", samples=N).replace(path)
    for ask in (
        lambda: run.row("o_1")[:],
        lambda: run.channels["o_1"],
        lambda: part.channels["o_1"],
        lambda: another_stretch(run, 5, 20).channels["o_1"],
    ):
        with pytest.raises(InputError, match=r"A1\.h5: was written again meanwhile"):
            ask()
    path.unlink()
    with pytest.raises(InputError, match=r"A1\.h5: no such file"):
        run.row("o_1")[:]
