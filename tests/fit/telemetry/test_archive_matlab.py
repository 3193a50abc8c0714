"""Archives in .mat files of every version, as SciPy and mat-io write them."""

import sys

import numpy as np
import pandas
import pytest
from matio import save_to_mat
from matio.utils import MatlabOpaque
from scipy.io import savemat
from scipy.io.matlab import MatlabObject

from fit.errors import InputError
from fit.telemetry.archives import open_table
from tests.fit.telemetry.columns import OUT, STAMPS, WHEN, N, T, X, Y, assert_same, message, read, reasons


def test_structs_and_matrices_of_scipy(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"data": {"t": T[:, None], "oms": {"x": X}}, "label": "of a test", "n": 2.0})
    assert_same(read(path), {"data.t": T, "data.oms.x": X})
    assert reasons(path) == {"label": "text", "n": "a single value"}
    assert_same(read(path, "data.oms"), {"x": X})
    savemat(tmp_path / "old.mat", {"out": OUT}, format="4")
    assert_same(read(tmp_path / "old.mat"), {f"out[{k + 1}]": OUT[:, k] for k in range(3)})
    with open_table(tmp_path / "old.mat", None) as archive:
        assert [archive.column(2), archive.column("out[3]")] == ["out[2]", "out[3]"]


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
    columns = {name: values for name, values in read(tmp_path / "a.mat").items() if values.size > 1}
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
    assert_same(dict(sorted(columns.items())), dict(sorted(expected.items())))
    assert reasons(tmp_path / "a.mat")["z"] == "complex numbers"


def test_objects_of_the_first_matlab(tmp_path):
    """An object before `classdef`, as old versions of LTPDA have it, is a struct with the name of a class."""
    fields = np.array([(X[:, None], "m")], dtype=[("y", "O"), ("yunits", "O")])
    savemat(tmp_path / "a.mat", {"a": MatlabObject(fields, "ao")})
    assert_same(read(tmp_path / "a.mat"), {"a.y": X})


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
        "plist": MatlabOpaque({"name": "of a test"}, "plist"),
    }
    save_to_mat(path, variables, version=version)


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_objects_of_matlab_and_ltpda(tmp_path, version):
    path = tmp_path / "a.mat"
    matlab_objects(path, version)
    columns = {name: values for name, values in read(path).items() if values.size > 1}
    assert_same(dict(sorted(columns.items())), dict(sorted(OBJECTS.items())))
    assert reasons(path)["a"] == "an object of class ao with the columns a.data.xaxis, a.data.yaxis"
    assert reasons(path)["plist"] == (
        "an object of class plist without numbers; save it from MATLAB as a struct"
    )
    assert_same(read(path, "nested.ao.data"), {"xaxis": T, "yaxis": X})
    with open_table(path, "times") as archive:
        assert archive.column(2) == "x"


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_objects_without_mat_io_are_named(tmp_path, monkeypatch, version):
    monkeypatch.setitem(sys.modules, "matio", None)
    save_to_mat(tmp_path / "a.mat", {"a": MatlabOpaque({"y": X[:, None]}, "ao"), "x": X}, version=version)
    why = "which is read with the extra lpfcosim[matlab] alone; save it from MATLAB as a struct"
    assert reasons(tmp_path / "a.mat") == {"a": f"an object of class ao, {why}"}
    assert_same(read(tmp_path / "a.mat"), {"x": X})
    assert message(tmp_path / "a.mat", "a.y") == f'column "a.y": a is an object of class ao, {why}'
    with pytest.raises(InputError, match=r"a\.mat: table 'a': an object of class ao, which is read with"):
        read(tmp_path / "a.mat", "a")
