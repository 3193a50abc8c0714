"""Columns of a run in several files and tables: a map finds them, and what disagrees is refused."""

import re

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from tests.fit.telemetry.mapped import CHANNELS, T0, N, assert_same, instants, isot, listed, write


def export(folder, channels, change=None):
    """Write a file for each channel, without names: time and value, as LTPDA exports its objects."""
    for name, values in channels.items():
        times = np.arange(N) / 10
        table = np.column_stack([change(name, times) if change else times, values])
        np.savetxt(folder / f"A_{name}.txt", table, "%.17g", "\t")


NUMBERED = dict.fromkeys(CHANNELS, "{ column = 2 }")
FILES = {
    "template": ('file = "{run}_{channel}.txt"', "column = 1", NUMBERED),
    "in the channels": (
        'file = "A_o_1.txt"',
        "column = 1",
        {name: f'{{ column = 2, file = "{{run}}_{name}.txt" }}' for name in CHANNELS},
    ),
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


def test_a_list_of_files_is_searched_for_the_columns(archive, channels):
    times = {"t": isot(instants(10.0))}
    for file, names in (("oms", CHANNELS[:2]), ("fee", CHANNELS[2:])):
        write(archive.folder / f"{file}.csv", times | listed({name: channels[name] for name in names}))
    run = archive.convert(run='file = ["oms.csv", "fee.csv"]', t0="")
    assert run.t0 == T0
    assert_same(run, channels)
    write(archive.folder / "both.csv", times | listed({name: channels[name] for name in CHANNELS[1:]}))
    message = archive.refusal(run='file = ["oms.csv", "both.csv"]')
    assert (
        "map.toml: runs[0].file: column o_12 (channel o_12): in each of oms.csv, both.csv, expected it in one"
        in message
    )
    message = archive.refusal(run='file = ["oms.csv", "oms.csv"]')
    assert "oms.csv: column f_x_1 (channel f_x_1): missing" in message
    write(archive.folder / "more.csv", times)
    message = archive.refusal(run='file = ["oms.csv", "more.csv"]')
    assert "column f_x_1 (channel f_x_1): in none of oms.csv, more.csv" in message


DISAGREEMENTS = {
    "start": (
        lambda name, t: t + 5 * (name == "f_x_1"),
        "A_f_x_1.txt: column 1: sample 0 5 s after ",
    ),
    "steps": (
        lambda name, t: t + np.where(np.arange(N) > 99, 0.1, 0.0) * (name == "o_12"),
        "A_o_12.txt: column 1: sample 100 0.1 s after ",
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


def test_a_table_for_each_channel(archive, channels):
    structs = {name: {"t": np.arange(N) / 10, "y": values} for name, values in channels.items()}
    savemat(archive.folder / "A.mat", structs)
    columns = dict.fromkeys(CHANNELS, '{ column = "y" }')
    assert_same(archive.convert(run='file = "A.mat"\ntable = "{channel}"', columns=columns), channels)
    tables = {name: f'{{ column = "y", table = "{name}" }}' for name in CHANNELS}
    assert_same(
        archive.convert(run='file = "A.mat"', clock='column = "t"\ntable = "o_1"', columns=tables), channels
    )
