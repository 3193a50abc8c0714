"""How results came about, as an SSP archive tells it: against digests of the files themselves."""

import hashlib
import json
import posixpath
import shutil
import zipfile

import h5py
import pytest
from lxml import etree

from tests.lpfcosim.cli.test_cli import SHORT, one_sentence

pytestmark = [pytest.mark.fmu, pytest.mark.slow]
STMD = "extra/org.ssp-standard.ssp-traceability.stmd/SimulationTask.stmd"


def sha256(content):
    return hashlib.sha256(content).hexdigest()


def entries(element):
    return {e.get("keyword"): e.text for e in element.iterfind("{*}Classification/{*}ClassificationEntry")}


@pytest.fixture
def short(tmp_path, lpfcosim):
    file = tmp_path / "short.toml"
    file.write_text(SHORT + "[fit]\ninclude_short = true\n")
    status, _, err = lpfcosim("run", file, "--jobs", "2", "--quiet")
    assert status == 0, err
    return file


def test_archive_tells_how_results_came_about(lpfcosim, short, tmp_path):
    folder = tmp_path / "short"
    status, out, err = lpfcosim("fmu", "export-ssp", short, "--ssp", "2.0", "--results", folder)
    assert (status, out.strip()) == (0, "short.ssp"), err
    with zipfile.ZipFile("short.ssp") as stored:
        inside = {name: stored.read(name) for name in stored.namelist()}
    assert inside["resources/results.json"] == (folder / "results.json").read_bytes()
    results = json.loads(inside["resources/results.json"])
    root = etree.fromstring(inside[STMD])
    executed = root.find("{*}ExecutionPhase/{*}ExecuteSimulation")

    flown = entries(executed.find("{*}Procedure"))
    assert flown["fmus_flown"] == "those inside"
    assert flown["fmu_Plant_sha256"] == sha256(inside["resources/Plant.fmu"])
    assert flown["seed"] == "3"
    names = {}
    for resource in executed.find("{*}Output"):
        place = posixpath.normpath(posixpath.join(posixpath.dirname(STMD), resource.get("source")))
        assert place not in inside  # it lies beside the archive, once that is unpacked
        assert entries(resource)["sha256"] == sha256((folder / place).read_bytes())
        names[f"#{resource.get('id')}"] = place
    assert set(names.values()) == {"telemetry/one.h5", "telemetry/one-noise.h5"}

    evaluated = root.find("{*}EvaluationPhase/{*}EvaluateSimulationResults")
    references = [r.get("{http://www.w3.org/1999/xlink}href") for r in evaluated.find("{*}Input")]
    assert sorted(references) == sorted(names)
    settings = entries(evaluated.find("{*}Procedure"))
    assert settings["estimator"] == "gaussian"
    assert settings["version numpy"] == results["provenance"]["versions"]["numpy"]
    assert entries(evaluated.find("{*}Output")[0])["sha256"] == sha256(inside["resources/results.json"])
    verdict = entries(root.find("{*}EvaluationPhase/{*}DeriveSimulationQualityVerdict/{*}Output"))
    assert float(verdict["chi2"]) == results["joint"]["chi2"]
    assert json.loads(verdict["sound"]) == results["joint"]["sound"]

    # An archive with other FMUs says so, and has another identity.
    assert lpfcosim("fmu", "export-ssp", short, "--results", folder)[0] == 0
    with zipfile.ZipFile("short.ssp") as stored:
        older = etree.fromstring(stored.read(STMD))
    assert entries(older.find("{*}ExecutionPhase/{*}ExecuteSimulation/{*}Procedure"))["fmus_flown"] == (
        "not those inside: Actuation, DragFreeControl, OpticalMetrology, Plant, SuspensionControl"
    )
    assert older.get("GUID") != root.get("GUID")


def test_results_of_something_else_are_refused(lpfcosim, short, tmp_path):
    folder = tmp_path / "short"

    def refused(*arguments):
        status, _, err = lpfcosim("fmu", "export-ssp", *arguments)
        assert status == 2
        return one_sentence(err)

    assert "nowhere: no such file or folder, expected results" in refused(
        short, "--results", tmp_path / "nowhere"
    )
    other = tmp_path / "other.toml"
    other.write_text(short.read_text().replace("seed = 3", "seed = 4"))
    assert "was not simulated from this campaign as it is now" in refused(other, "--results", folder)
    changed = tmp_path / "changed"
    shutil.copytree(folder, changed)
    with h5py.File(changed / "telemetry" / "one.h5", "a") as file:
        file.attrs["fmu_Plant"] = "0" * 64
    assert "one.h5: was simulated with another Plant than other runs" in refused(short, "--results", changed)
    (changed / "telemetry" / "one.h5").unlink()
    assert "one.h5: cannot be read" in refused(short, "--results", changed)
