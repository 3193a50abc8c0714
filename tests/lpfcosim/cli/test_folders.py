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


def test_after_mcmc_every_command_takes_the_folder_as_before(lpfcosim, refusal, flight, tmp_path):
    _, _, err = lpfcosim("mcmc", "flight", "--steps", 20, "--quiet", status=1)
    assert "not converged after 20 steps" in err and not (flight / "mcmc.json").exists()
    _, out, _ = lpfcosim("mcmc", "flight", "--steps", 2000, "--json", "--quiet", status=0)
    document = json.loads(out)
    assert document == json.loads((flight / "mcmc.json").read_text())
    joint = json.loads((flight / "results.json").read_text())["joint"]
    for name, p in document["parameters"].items():
        estimate = joint["parameters"][name]
        assert abs(p["shift_in_sigma"]) < 5 * p["shift_error"] and p["tau"] < 10
        assert p["mean"] == pytest.approx(estimate["value"], abs=0.2 * estimate["sigma"])
    page = (flight / "report.html").read_text(encoding="utf-8")
    assert f"{document['steps']} steps of {document['walkers']} walkers" in page
    (flight / "report.html").unlink()
    lpfcosim("report", "flight", status=0)
    assert (flight / "report.html").read_text(encoding="utf-8").split() == page.split()

    with h5py.File(flight / "other.h5", "w") as file:
        file["x"] = [1.0]
    lpfcosim("fit", "flight", "--out", "second", "--quiet", status=0)
    assert json.loads((tmp_path / "second" / "results.json").read_text())["joint"] == joint
    for folder in ("flight", "second"):  # `second` has its telemetry elsewhere
        _, out, err = lpfcosim("deltag", folder, "--out", f"{folder}-deltag", status=0)
        assert f"calibration: {folder}/results.json\n" in err
        assert len(out.splitlines()) == 4
    assert ": channel o_1: missing" in refusal("fit", "flight-deltag", "--out", "third")
    out = lpfcosim("compare", "flight", "second/results.json", "--json", "--quiet", status=0)[1]
    compared = json.loads(out, parse_constant=pytest.fail)
    assert compared["results"] == ["flight", "second/results.json"]
    assert compared["joint"]["lambda_2"]["differences"] == [None, 0.0]


def test_telemetry_of_several_results_needs_the_calibration_named(lpfcosim, refusal, flight, tmp_path):
    other = shutil.copytree(flight, tmp_path / "other")
    names = sorted(path.name for path in (flight / "telemetry").iterdir())
    paths = [f"{folder}/telemetry/{name}" for folder, name in zip(("flight", "other"), names, strict=False)]
    lpfcosim("deltag", *paths, "--out", "same", status=0)  # a copy
    document = (other / "results.json").read_text()
    (other / "results.json").write_text(document.replace('"chi2": ', '"chi2": 1', 1))
    refused = refusal("deltag", *paths, "--out", "out")
    assert refused.startswith("other/results.json: other results than flight/results.json, expected one")
    (other / "results.json").unlink()
    refused = refusal("deltag", *paths, "--out", "out")
    assert refused.startswith(f"{paths[1]}: no results.json in its folder")
    assert not (tmp_path / "out").exists()


def test_figures_are_drawn_when_asked_for(lpfcosim, flight):
    out = lpfcosim("figures", flight, "A-breakdown", "over", "--jobs", "1", status=0)[1]
    drawn = [path.stem for path in (flight / "figures").iterdir()]
    assert {*drawn} == {"residual-over-noise", "e1b-A-breakdown"}
    assert len(drawn) == 6
    assert f"2 figures: {flight / 'figures'}" in out
