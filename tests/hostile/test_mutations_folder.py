"""Folders of results that are damaged or hostile: nothing outside them is written, and one sentence told."""

import json
import random
import shutil
from dataclasses import replace

import pytest

from fit import results as fit_results
from fit.crosstalk import refit
from fit.pipeline import calibrate
from fit.report import page as report
from tests.hostile.mutations import restructured, survives
from tests.oracles.synthetic import World, pair
from tests.synthetic_files import write_run

pytestmark = pytest.mark.slow


def content(folder):
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*"))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder of results without its report."""
    folder = tmp_path_factory.mktemp("made") / "out"
    (folder / "telemetry").mkdir(parents=True)
    runs = [
        refit.read_all([write_run(r, folder / "telemetry" / f"{r.run}.h5")], trusted=True)[0]
        for r in pair(World())
    ]
    results = calibrate(runs)
    names = [f"telemetry/{r.run}.h5" for r in runs]
    results = replace(results, provenance=replace(results.provenance, telemetry=names))
    fit_results.write(results, folder / "results.json")
    return folder


@pytest.fixture
def copied(made, tmp_path):
    return shutil.copytree(made, tmp_path / "in" / "out")


def rebuild(folder):
    """Do as ``lpfcosim report``; the drawings are those of other tests."""
    results, runs = refit.load(folder)
    report.write_report(folder, results, runs)


@pytest.mark.slow
def test_results(copied, cases):
    good = (copied / "results.json").read_text()
    for n in range(cases(0.01, 25)):
        rng = random.Random(n)
        path = copied / "results.json"
        path.write_text(json.dumps(restructured(json.loads(good), rng)))
        survives(lambda: rebuild(copied), path, f"folder {n}")
    assert content(copied.parent.parent)[:2] == ["in", "in/out"]
    assert {p.name for p in copied.iterdir()} <= {"results.json", "telemetry", "report.html", "figures"}
