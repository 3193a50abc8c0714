"""Telemetry in CSV, MATLAB and FITS: the same numbers as in HDF5, and one sentence for whatever is wrong."""

import re

import numpy as np
import pytest
from astropy.io import fits
from scipy.io import savemat

from fit.telemetry.conversion import convert
from fit.telemetry.reader import read_all
from tests.oracles.contract_file import write_contract_file
from tests.oracles.synthetic import World, pair

COLUMNS = {"o_1": "OMS_x1", "o_12": "OMS_x12", "f_x_1": "a1", "f_x_2": "a2"}
UNITS = {"o_1": "m", "o_12": "m", "f_x_1": "m s-2", "f_x_2": "m s-2"}
SHARED = ("F_max_1", "F_max_2", "N_max_1", "N_max_2", "alignment_epoch", "m_tm")


def as_csv(path, columns, delimiter=","):
    lines = ["# an archive", delimiter.join(columns)]
    lines += [delimiter.join(map(repr, row)) for row in np.column_stack(list(columns.values())).tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def as_mat(path, columns):
    savemat(path, {"data": {name: values[:, None] for name, values in columns.items()}, "note": "of a test"})


def as_fits(path, columns, units=None):
    table = [
        fits.Column(name, "D", unit=(units or {}).get(name), array=values) for name, values in columns.items()
    ]
    hdus = [fits.PrimaryHDU(), fits.BinTableHDU.from_columns(table, name="OMS")]
    fits.HDUList(hdus).writeto(path)


FORMATS = {
    "csv": (as_csv, ""),
    "mat": (as_mat, 'table = "data"\n'),
    "fits": (as_fits, 'table = "OMS"\n'),
}


def columns_of(run, offset=1.1e9):
    named = {COLUMNS[name]: values for name, values in run.channels.items()}
    return {"t": offset + run.time, "temperature": np.full(run.time.size, 21.5), **named}


def map_of(runs, suffix, table="", units=UNITS):
    shared = "".join(f"{name} = {getattr(runs[0], name)!r}\n" for name in SHARED)
    channels = "".join(f'{n} = {{ column = "{c}", unit = "{units[n]}" }}\n' for n, c in COLUMNS.items())
    entries = "".join(
        f'[[runs]]\nfile = "{r.run}.{suffix}"\nrun = "{r.run}"\nexperiment = "{r.experiment}"\n'
        f'kind = "{r.kind}"\nt0 = {r.t0}\n{table}'
        for r in runs
    )
    return (
        f'schema = "lpf-map/1"\n[attributes]\n{shared}[channels]\n{channels}'
        f'[time]\ncolumn = "t"\nunit = "s"\n{entries}'
    )


@pytest.fixture(scope="module")
def runs():
    return pair(World(), "E", duration=2400.0, drive_1=1e-13, experiment="E1")


@pytest.fixture(scope="module")
def contract(runs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("contract")
    for run in runs:
        attributes = {name: getattr(run, name) for name in ("run", "experiment", "kind", "fs", "t0", *SHARED)}
        channels = {name: (values, UNITS[name]) for name, values in run.channels.items()}
        write_contract_file(folder / f"{run.run}.h5", samples=run.time.size, channels=channels, **attributes)
    return folder


@pytest.fixture(scope="module")
def archive(runs, tmp_path_factory):
    """Write the runs in a format; returns the map."""

    def write(suffix):
        folder = tmp_path_factory.mktemp("archive")
        writer, table = FORMATS[suffix]
        for run in runs:
            writer(folder / f"{run.run}.{suffix}", columns_of(run))
        (folder / "map.toml").write_text(map_of(runs, suffix, table))
        return folder / "map.toml"

    return write


@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_gives_the_telemetry_of_the_contract(archive, contract, tmp_path, suffix):
    expected = read_all(sorted(contract.glob("*.h5")))
    converted = read_all(convert([archive(suffix)], tmp_path / "telemetry", any_gaps=False))
    assert [run.run for run in converted] == [run.run for run in expected]
    for run, reference in zip(converted, expected, strict=True):
        for name in ("experiment", "kind", "fs", *SHARED):
            assert getattr(run, name) == getattr(reference, name)
        np.testing.assert_array_equal(run.time, reference.time)
        assert run.channels.keys() == reference.channels.keys()
        for name in UNITS:
            np.testing.assert_array_equal(run.channels[name], reference.channels[name])
    assert {file.name for file in tmp_path.iterdir()} == {"telemetry"}


def in_map(old, new):
    def change(map_path):
        text = map_path.read_text()
        assert re.search(old, text)
        map_path.write_text(re.sub(old, new, text, count=1))

    return change


def in_archive(old, new, line=None):
    def change(map_path):
        file = map_path.parent / "E1-noise.csv"
        lines = file.read_text().splitlines()
        numbers = range(len(lines)) if line is None else [line]
        for i in numbers:
            lines[i] = re.sub(old, new, lines[i])
        file.write_text("\n".join(lines))

    return change


FAULTS = {
    "missing channel": (in_map("f_x_2 = ", "f_x_3 = "), r"map\.toml: channels\.f_x_2: missing"),
    "missing column": (
        in_archive("OMS_x12", "OMS"),
        r"E1-noise\.csv: column OMS_x12 \(channel o_12\): missing, did you mean",
    ),
    "too many missing": (
        in_archive("21.5,[^,]*", "21.5,nan"),
        r"column OMS_x1 \(channel o_1\): nan from sample 0 .*, expected at most 1 % and 600 s",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_sentence_and_leaves_nothing(lpfcosim, archive, tmp_path, fault):
    change, expected = FAULTS[fault]
    map_path = archive("csv")
    change(map_path)
    status, _, err = lpfcosim("fit", map_path, "--out", "result")
    (sentence,) = err.strip().splitlines()
    assert status == 2
    assert sentence.startswith(f"lpfcosim: error: {map_path.parent}")
    assert re.search(expected, sentence), sentence
    assert not list(tmp_path.iterdir())
