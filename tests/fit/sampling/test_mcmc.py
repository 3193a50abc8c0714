"""The command `mcmc`."""

import json
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest

from fit import results
from fit.forecasting import coverage
from fit.parameters import FLIGHT
from fit.pipeline import calibrate
from fit.telemetry import reader as telemetry
from tests.oracles.contract_file import write_contract_file
from tests.oracles.synthetic import World, pair

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def calibrated_once(tmp_path_factory):
    """A folder as `lpfcosim fit` leaves it, in a folder with its telemetry."""
    folder = tmp_path_factory.mktemp("calibrated")
    truth = {name: value for name, value in vars(World()).items() if name in FLIGHT}
    for run in (run for a in "AB" for run in pair(World(), a)):
        channels = {name: (x, "m" if name[0] == "o" else "m s-2") for name, x in run.channels.items()}
        attributes = {key: getattr(run, key) for key in ("run", "experiment", "kind", "fs", "F_max_2")}
        path = folder / f"{run.run}.h5"
        write_contract_file(path, samples=run.time.size, channels=channels, truth=truth, **attributes)
    telemetries = telemetry.read_all(sorted(folder.glob("*.h5")))
    calibration = calibrate(telemetries)
    directory = folder / "out"
    directory.mkdir()
    names = [os.path.relpath(t.path, directory) for t in telemetries]
    calibration = replace(calibration, provenance=replace(calibration.provenance, telemetry=names))
    results.write(coverage.with_truth(calibration, telemetries), directory / "results.json")
    return folder


@pytest.fixture
def calibrated(calibrated_once, tmp_path):
    """A copy of the folder `out` of `calibrated_once`, for one test."""
    return shutil.copytree(calibrated_once, tmp_path / "in") / "out"


def test_command(lpfcosim, calibrated):
    status, _, err = lpfcosim("mcmc", calibrated, "--steps", 100, "--quiet")
    assert status == 1
    assert err.count("\n") == 1
    assert "mcmc.h5: not converged after 100 steps" in err
    assert not (calibrated / "mcmc.json").exists()
    status, out, err = lpfcosim("mcmc", calibrated)
    assert status == 0, err
    assert "of the joint fit" in out
    assert "Warning" not in err
    document = json.loads((calibrated / "mcmc.json").read_text())
    assert document["schema"] == "lpf-mcmc/1"
    joint = json.loads((calibrated / "results.json").read_text())["joint"]
    assert list(document["parameters"]) == joint["names"]
    for name, entry in document["parameters"].items():
        assert abs(entry["shift_in_sigma"]) < 5 * entry["shift_error"]
        assert entry["sigma_ratio"] == pytest.approx(1, abs=0.01 + 5 * entry["sigma_ratio_error"])
        assert entry["mean"] == pytest.approx(
            joint["parameters"][name]["value"], abs=0.2 * joint["parameters"][name]["sigma"]
        )
        assert entry["truth"] == joint["parameters"][name]["truth"]
    assert {"lambda_1", "C_1"} < set(document["indeterminable"])
    assert "<svg" in (calibrated / "figures" / "corner.svg").read_text(encoding="utf-8")
    page = (calibrated / "report.html").read_text(encoding="utf-8")
    assert f"{document['steps']} steps of {document['walkers']} walkers" in page
    assert page.count("data:image/svg+xml") == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.pop("joint"), "joint: expected a joint fit"),
        (lambda r: r["provenance"].pop("telemetry"), "provenance.telemetry: expected a list"),
        (lambda r: r["provenance"].pop("settings"), "expected joint_runs, noise_runs and settings"),
        (lambda r: r["provenance"]["settings"].update(estimator="magic"), "provenance.settings.estimator"),
        (lambda r: r["provenance"]["joint_runs"].append("Z"), "run 'Z' is in none of the telemetry files"),
        (
            lambda r: r["joint"]["parameters"]["lambda_2"].update(value=1.0),
            "joint.parameters.lambda_2: 1, exp",
        ),
    ],
)
def test_results_that_cannot_be_repeated(lpfcosim, calibrated, change, message):
    path = calibrated / "results.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    status, _, err = lpfcosim("mcmc", calibrated, "--steps", 10)
    assert status == 2
    assert message in err
    assert not (calibrated / "mcmc.h5").exists()


def test_instruments_move_and_widen_the_posterior_as_the_results(lpfcosim, calibrated):
    path = calibrated / "results.json"
    document = json.loads(path.read_text())
    estimate = document["joint"]["parameters"]["lambda_2"]
    estimate["value"] += estimate["sigma"]
    estimate["sigma"] *= 2
    covariance = np.array(document["joint"]["covariance"])
    i = list(document["joint"]["parameters"]).index("lambda_2")
    covariance[i] *= 2
    covariance[:, i] *= 2
    document["joint"]["covariance"] = covariance.tolist()
    warning = {
        "code": "instrumental_variables",
        "parameters": ["lambda_2"],
        "message": "given beside couplings",
    }
    document["joint"]["warnings"].append(warning)
    path.write_text(json.dumps(document))
    status, _, err = lpfcosim("mcmc", calibrated)
    assert status == 0, err
    assert "then corrected and widened as by instrumental variables: lambda_2" in err
    sampled = json.loads((calibrated / "mcmc.json").read_text())["parameters"]["lambda_2"]
    assert abs(sampled["shift_in_sigma"]) < 5 * sampled["shift_error"]
    assert sampled["mean"] == pytest.approx(estimate["value"], abs=0.1 * estimate["sigma"])
    assert sampled["sigma"] == pytest.approx(estimate["sigma"], rel=0.1)
    page = (calibrated / "report.html").read_text(encoding="utf-8")
    assert "Posterior sampled" in page
    assert "The chain is of another fit" not in page


def test_the_posterior_has_the_constraints_of_the_fit(lpfcosim, calibrated):
    value, folder = World().C_2, calibrated.parent
    options = ["--fix", f"C_2={value}", "--tie", "alpha_phi_1=alpha_phi_2", "--bound", "lambda_2=1.0:1.1"]
    status, _, err = lpfcosim("fit", folder, "--out", calibrated, *options)
    assert status == 0, err
    status, _, err = lpfcosim("mcmc", calibrated)
    assert status == 0, err
    document = json.loads((calibrated / "mcmc.json").read_text())
    assert document["fixed"] == {"C_2": value}
    assert "C_2" not in document["parameters"]
    assert f"C_2 fixed at {value:.9g}" in document["constraints"]
    assert "lambda_2 between 1 and 1.1" in document["constraints"]
    joint = json.loads((calibrated / "results.json").read_text())["joint"]["parameters"]
    for name, entry in document["parameters"].items():
        assert abs(entry["shift_in_sigma"]) < 5 * entry["shift_error"]
        assert entry["sigma"] == pytest.approx(joint[name]["sigma"], rel=0.1)
    page = (calibrated / "report.html").read_text(encoding="utf-8")
    assert f"With constraints: {'; '.join(document['constraints'])}" in page
    assert "The chain is of another fit" not in page


def test_folder_without_results(lpfcosim, tmp_path):
    status, _, err = lpfcosim("mcmc", tmp_path)
    assert status == 2
    assert "no results.json in it, expected the folder of an earlier run or fit" in err
