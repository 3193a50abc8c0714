"""Folders of results that are damaged or hostile: nothing outside them is written, and one sentence told."""

import json
import random
import re
import shutil
from dataclasses import replace

import pytest

from fit import results as fit_results
from fit.crosstalk import refit
from fit.errors import InputError
from fit.pipeline import calibrate
from fit.report import page as report
from lpfcosim.workflows import montecarlo
from tests.hostile.mutations import damaged, hostile, restructured, survives
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


@pytest.mark.parametrize(
    "name",
    ["../../evil", "/tmp/evil", "a/b", "..", "x" * 300, "y" * 90, "\u202eevil", "<evil>", "a\nb", "con"],
)
def test_names_of_experiments(tmp_path, name):
    folder = tmp_path / "in" / "out"
    (folder / "telemetry").mkdir(parents=True)
    paths = [
        write_run(r, folder / "telemetry" / f"{k}.h5", {"run": f"{name}{k}", "experiment": name})
        for k, r in enumerate(pair(World()))
    ]

    names = []

    def work():
        runs = refit.read_all(paths, trusted=True)
        results = calibrate(runs)
        report.write_report(folder, results, runs)
        names.extend(figure.name for figure in report.figure_specs(results, runs, folder))

    sentence = survives(work, folder / "telemetry" / "x", name)
    assert (sentence is None) == (name.isprintable() and len(name) <= 100)
    assert {p.name for p in tmp_path.iterdir()} == {"in"}
    assert {p.name for p in (tmp_path / "in").iterdir()} == {"out"}
    assert {p.name for p in folder.iterdir()} <= {"telemetry", "report.html"}
    if sentence is None:
        assert len(names) > 4
        assert all(re.fullmatch(r"[\w-]{1,80}", each) for each in names)  # of files
        assert "<evil>" not in (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("document", ["mcmc.json", "montecarlo.json"])
def test_what_other_commands_left(copied, document, cases):
    results = fit_results.load(copied / "results.json")
    schema = f"lpf-{document[:-5]}/1"
    for n in range(cases(0.005, 30)):
        rng = random.Random(n)
        value = {"schema": schema, "n": 2, "parameters": {"C_2": hostile(rng)}, "steps": hostile(rng)}
        path = copied / document
        path.write_text(json.dumps(value if n % 3 else hostile(rng)))
        survives(lambda: report.sampling.sections(results, copied), path, f"{document} {n}")


LOG = [{"number": k, "estimates": {"C_2": [0.1 * k, 1e-3]}} for k in range(5)]


def test_logs_of_campaigns(tmp_path, cases):
    header = {"campaign_digest": "x"}
    path = tmp_path / "campaigns.jsonl"
    for n in range(cases(0.02, 100)):
        rng = random.Random(n)
        lines = restructured({"lines": json.loads(json.dumps(LOG))}, rng).get("lines") if n % 2 else LOG
        lines = lines if isinstance(lines, list) else [lines]
        text = "".join(json.dumps(line) + "\n" for line in [header, *lines])
        path.write_bytes(text.encode() if n % 2 else damaged(text.encode(), rng))

        def read():
            kept = montecarlo.read_log(path, header)
            montecarlo.coverage.summary([line["estimates"] for line in kept.values()])

        survives(read, path, f"log {n}")


def test_what_is_read_names_a_file_that_is_none(copied):
    document = json.loads((copied / "results.json").read_text())
    for names in (["/dev/zero"], ["../../../etc/passwd"], ["x" * 5000], ["a\x00b"], ["."], [""]):
        document["provenance"]["telemetry"] = names
        (copied / "results.json").write_text(json.dumps(document))
        with pytest.raises(InputError):
            rebuild(copied)
