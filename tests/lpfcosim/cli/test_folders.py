"""Folders of results as inputs of commands, whatever other commands left in them."""

import json
import shutil

import h5py
import pytest

import fit
from tests.oracles.synthetic import World, pair
from tests.synthetic_files import write_run


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """A folder as `lpfcosim run` leaves it, of two experiments."""
    folder = tmp_path_factory.mktemp("once") / "flight"
    (folder / "telemetry").mkdir(parents=True)
    for run in (run for a in "AB" for run in pair(World(), a)):
        write_run(run, folder / "telemetry" / f"{run.run}.h5")
    runs = fit.load(folder)
    fit.save_report(fit.calibrate(runs), runs, folder)
    return folder


@pytest.fixture
def flight(once, tmp_path):
    return shutil.copytree(once, tmp_path / "flight")


def sentence(result):
    """Return the one sentence of a refusal."""
    status, _, err = result
    assert status == 2, err
    (line,) = [line for line in err.splitlines() if line.startswith("lpfcosim: error: ")]
    return line.removeprefix("lpfcosim: error: ")


def test_after_mcmc_every_command_takes_the_folder_as_before(lpfcosim, flight):
    _, _, err = lpfcosim("mcmc", "flight", "--steps", 20, "--quiet", status=1)
    assert "not converged after 20 steps" in err and not (flight / "mcmc.json").exists()
    _, out, _ = lpfcosim("mcmc", "flight", "--steps", 2000, "--json", "--quiet", status=0)
    document = json.loads(out)
    assert document == json.loads((flight / "mcmc.json").read_text())
    joint = json.loads((flight / "results.json").read_text())["joint"]["parameters"]
    for name, p in document["parameters"].items():
        assert abs(p["shift_in_sigma"]) < 5 * p["shift_error"] and p["tau"] < 10
        assert p["mean"] == pytest.approx(joint[name]["value"], abs=0.2 * joint[name]["sigma"])
    page = (flight / "report.html").read_text(encoding="utf-8")
    assert f"{document['steps']} steps of {document['walkers']} walkers" in page
    assert page.count("data:image/svg+xml") == 1 and "The chain is of another fit" not in page
    with h5py.File(flight / "other.h5", "w") as file:
        file["x"] = [1.0]
    status, _, err = lpfcosim("fit", "flight", "--out", "second", "--quiet")
    assert (status, err) == (0, "")
    first, second = (
        json.loads((flight.parent / name / "results.json").read_text()) for name in ("flight", "second")
    )
    assert second["joint"] == first["joint"]
    # `second` has its telemetry elsewhere
    for folder in ("flight", "second"):
        _, out, err = lpfcosim("deltag", folder, "--out", f"{folder}-deltag", status=0)
        assert f"calibration: {folder}/results.json\n" in err
        assert len(out.splitlines()) == 4
        assert [run.run for run in fit.load(folder)] == [run.run for run in fit.load("flight/telemetry")]
        assert (
            fit.load_results(folder).joint["lambda_2"].value
            == first["joint"]["parameters"]["lambda_2"]["value"]
        )
    assert ": channel o_1: missing" in sentence(lpfcosim("fit", "flight-deltag", "--out", "third"))
    assert not (flight.parent / "third").exists()


def test_telemetry_of_several_results_needs_the_calibration_named(lpfcosim, flight, tmp_path):
    other = shutil.copytree(flight, tmp_path / "other")
    names = sorted(path.name for path in (flight / "telemetry").iterdir())
    paths = [f"{folder}/telemetry/{name}" for folder, name in zip(("flight", "other"), names, strict=False)]
    lpfcosim("deltag", *paths, "--out", "same", status=0)  # a copy
    document = (other / "results.json").read_text()
    (other / "results.json").write_text(document.replace('"chi2": ', '"chi2": 1', 1))
    said = sentence(lpfcosim("deltag", *paths, "--out", "out"))
    assert said.startswith(
        "other/results.json: other results than flight/results.json, expected one calibration"
    )
    (other / "results.json").unlink()
    said = sentence(lpfcosim("deltag", *paths, "--out", "out"))
    assert said.startswith(f"{paths[1]}: no results.json in its folder")
    assert not (tmp_path / "out").exists()


def test_compare(lpfcosim, flight, tmp_path):
    lpfcosim("fit", "flight", "--settings", settings(tmp_path), "--out", "second", "--quiet", status=0)
    out = lpfcosim("compare", "flight", "second", status=0)[1]
    head, first, *_ = out.splitlines()
    assert head.split() == ["parameter", "unit", "flight", "second", "difference/sigma"]
    assert first.split()[0] == "lambda_2"
    assert "second and flight both use A-noise, A-sysid, B-noise, B-sysid: difference/sigma" in out
    status, out, err = lpfcosim("compare", "flight", "second/results.json", "--json", "--quiet")
    assert (status, err) == (0, "")
    document = json.loads(out, parse_constant=pytest.fail)
    assert document["results"] == ["flight", "second/results.json"]
    values = [estimate["value"] for estimate in document["joint"]["lambda_2"]["estimates"]]
    sigmas = [estimate["sigma"] for estimate in document["joint"]["lambda_2"]["estimates"]]
    expected = (values[1] - values[0]) / sum(sigma**2 for sigma in sigmas) ** 0.5
    assert document["joint"]["lambda_2"]["differences"] == [None, pytest.approx(expected)]
    assert lpfcosim("compare", "flight", "second", "--quiet") == (0, "", "")


def settings(folder):
    file = folder / "settings.toml"
    file.write_text('[fit]\nestimator = "student_t"\n', encoding="utf-8")
    return file
