"""Columns of a run in several files and tables: a map finds them, and what disagrees is refused."""

import re

import h5py
import numpy as np
import pytest

from tests.fit.telemetry.mapped import CHANNELS, T0, N, assert_same


def export(folder, channels, change=None):
    """Write a file for each channel, without names: time and value, as LTPDA exports its objects."""
    for name, values in channels.items():
        times = np.arange(N) / 10
        table = np.column_stack([change(name, times) if change else times, values])
        np.savetxt(folder / f"A_{name}.txt", table, "%.17g", "\t")


NUMBERED = dict.fromkeys(CHANNELS, "{ column = 2 }")
FILES = {
    "template": ('file = "{run}_{channel}.txt"', "column = 1", NUMBERED),
    "one clock": ('file = "A_{channel}.txt"', 'column = 1\nfile = "A_o_1.txt"', NUMBERED),
}


@pytest.mark.parametrize("way", FILES)
def test_a_file_for_each_channel(archive, channels, way):
    run, clock, columns = FILES[way]
    export(archive.folder, channels)
    run = archive.convert(run=run, clock=clock, columns=columns)
    assert (run.t0[:19], run.fs) == (T0[:19], 10.0)
    assert_same(run, channels)
    with h5py.File(run.path) as file:
        names, digests = (file.attrs[key].split(", ") for key in ("archive", "archive_sha256"))
    assert set(names) == {f"A_{name}.txt" for name in CHANNELS}
    assert len(set(digests)) == 4 and all(re.fullmatch("[0-9a-f]{64}", digest) for digest in digests)


DISAGREEMENTS = {
    "start": (
        lambda name, t: t + 5 * (name == "f_x_1"),
        "A_f_x_1.txt: column 1: sample 0 5 s after ",
    ),
    "a fifth of a sample": (
        lambda name, t: t + 0.02 * (name == "f_x_1"),
        "A_f_x_1.txt: column 1: on average 0.02 s after ",
    ),
}


@pytest.mark.parametrize("fault", DISAGREEMENTS)
def test_files_that_disagree_about_the_time(archive, channels, fault):
    change, expected = DISAGREEMENTS[fault]
    export(archive.folder, channels, change)
    run, clock, columns = FILES["template"]
    message = archive.refusal(run=run, clock=clock, columns=columns)
    assert message.startswith(expected) and "A_o_1.txt" in message
    assert message.endswith("expected the same time stamps in all files of a run")
