"""Folders as inputs: which telemetry and which results a path means."""

import json

import h5py
import pytest

from fit.crosstalk import refit
from fit.errors import InputError
from fit.results.folders import results_beside, results_file, telemetry_files
from tests.oracles.contract_file import write_contract_file


def results(folder, *telemetry, name="results.json", **entries):
    """Write results without any fit, which name telemetry."""
    folder.mkdir(exist_ok=True)
    document = {"schema": "lpf-results/1", "provenance": {"telemetry": list(telemetry)}, **entries}
    (folder / name).write_text(json.dumps(document), encoding="utf-8")
    return folder / name


def telemetry(folder, *runs):
    folder.mkdir(parents=True, exist_ok=True)
    return [write_contract_file(folder / f"{run}.h5", run=run) for run in runs]


def other_file(folder, name="other.h5"):
    with h5py.File(folder / name, "w") as file:
        file.create_group("group")
        file["fingerprint"] = [0.0]


def refused(function, *arguments):
    with pytest.raises(InputError) as raised:
        function(*arguments)
    message = str(raised.value)
    assert "\n" not in message
    assert "expected" in message
    return message


# Telemetry ------------------------------------------------------------------------------------------------


def test_a_plain_folder_means_its_telemetry_once_without_hidden_files(tmp_path):
    files = telemetry(tmp_path, "b", "a")
    (tmp_path / "._a.h5").write_bytes(b"AppleDouble")
    (tmp_path / "readme.txt").write_text("Dear diary")
    assert telemetry_files([tmp_path]) == sorted(files)
    assert telemetry_files([files[0], tmp_path, tmp_path / "nowhere"]) == [*files, tmp_path / "nowhere"]


@pytest.mark.parametrize("with_results", [False, True])
def test_a_folder_of_a_run_means_its_telemetry_whatever_lies_beside(tmp_path, with_results):
    files = telemetry(tmp_path / "telemetry", "a", "b", "failed")
    other_file(tmp_path)
    other_file(tmp_path, "jitter.h5")
    write_contract_file(tmp_path / "a-deltag.h5")
    if with_results:
        results(tmp_path, "telemetry/a.h5", "telemetry/b.h5")
    assert telemetry_files([tmp_path]) == files


@pytest.mark.parametrize("others", [["b"], ["b", "failed"]])
def test_the_loss_of_telemetry_that_results_name_is_reported(tmp_path, others):
    telemetry(tmp_path / "telemetry", *others)
    results(tmp_path, "telemetry/a.h5", "telemetry/b.h5")
    message = refused(telemetry_files, [tmp_path])
    assert message.startswith(f"{tmp_path / 'telemetry' / 'a.h5'}: no such file, expected telemetry that ")
    assert str(tmp_path / "results.json") in message


def test_results_without_telemetry_beside_them_mean_what_they_name(tmp_path):
    files = telemetry(tmp_path / "flight", "a", "b", "other")
    results(tmp_path / "out", "../flight/a.h5", "../flight/b.h5")
    other_file(tmp_path / "out")
    assert telemetry_files([tmp_path / "out"]) == files[:2]
    files[1].unlink()
    message = refused(telemetry_files, [tmp_path / "out"])
    assert message.startswith(f"{files[1]}: no such file, expected telemetry that ")
    assert str(tmp_path / "out" / "results.json") in message


def test_results_among_their_telemetry(tmp_path):
    files = telemetry(tmp_path, "a", "b")
    results(tmp_path, "a.h5", "b.h5")
    other_file(tmp_path)
    assert telemetry_files([tmp_path]) == files
    telemetry(tmp_path, "new")
    message = refused(telemetry_files, [tmp_path])
    assert f"has telemetry (new.h5) other than that of its results ({files[0]} ...)" in message


def test_results_are_no_telemetry(tmp_path):
    file = results(tmp_path)
    assert refused(telemetry_files, [file]).endswith(f"expected telemetry; did you mean {tmp_path}?")


# Results --------------------------------------------------------------------------------------------------


def test_results_by_their_file_or_their_folder(tmp_path):
    file, other = results(tmp_path), results(tmp_path, name="identified.json")
    assert results_file(tmp_path) == results_file(file) == file
    assert results_file(other) == other
    with pytest.raises(InputError, match="is a file, expected the folder"):
        refit.load(file)


def test_results_beside_telemetry(tmp_path, monkeypatch):
    (run,) = telemetry(tmp_path / "out" / "telemetry", "a")
    file = results(tmp_path / "out", "telemetry/a.h5")
    for path in (tmp_path / "out", run.parent, run):
        assert results_beside(path) == file
    monkeypatch.chdir(run.parent)
    assert results_beside(type(run)("a.h5")).samefile(file)
    assert results_beside(tmp_path) is None
    assert "no such file or folder" in refused(results_beside, tmp_path / "nowhere")
