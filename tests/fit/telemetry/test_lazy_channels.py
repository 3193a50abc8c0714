"""Channels are read when they are asked for, from the file as it was first."""

import h5py
import numpy as np
import pytest

from fit.errors import InputError
from fit.telemetry.reader import open_run
from tests.oracles.contract_file import write_contract_file

N = 200


@pytest.mark.parametrize(
    "form", [{}, {"dtype": ">f8"}, {"dtype": "f4"}, {"chunks": (64,), "compression": "gzip"}]
)
@pytest.mark.parametrize("rewriting", ["replaced", "in place"])
def test_parts_are_those_of_the_file_unless_it_is_written_again(tmp_path, form, rewriting):
    """Half of a run from before and half from now would look like one."""
    path, x = write_contract_file(tmp_path / "A1.h5", samples=N), np.arange(N) / 8
    with h5py.File(path, "a") as file:
        del file["o_1"]
        file.create_dataset("o_1", data=x, **form).attrs["units"] = "m"
    run = open_run(path)
    part = run.part(slice(20, 170)).part(slice(10, None))
    assert np.array_equal(run.channels["o_1"], x)
    assert np.array_equal(part.channels["o_1"], x[30:170])
    assert np.array_equal(part.time, np.arange(30, 170) / 10)
    assert part.size == 140
    if rewriting == "in place":
        with h5py.File(path, "a") as file:
            file["o_1"][3] = 0.5
    else:
        write_contract_file(tmp_path / "other.h5", samples=N).replace(path)
    for channels in (run.channels, part.channels, run.part(slice(5, 20)).channels):
        with pytest.raises(InputError, match=r"A1\.h5: was written again meanwhile"):
            channels["o_1"]
    path.unlink()
    with pytest.raises(InputError, match=r"A1\.h5: no such file"):
        run.channels["o_1"]
