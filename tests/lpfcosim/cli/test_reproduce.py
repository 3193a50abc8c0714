"""The whole command: what failed is told and missing in the report; what is there can be made again."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from lpfcosim.campaign import loading
from lpfcosim.modelica import build
from tests.hostile.faulty import SEGFAULT, after, faulty
from tests.hostile.test_resume import PLAN, content
from tests.lpfcosim.cli.refusal import refusal
from tests.lpfcosim.cli.test_cli import SHORT

pytestmark = [pytest.mark.fmu, pytest.mark.slow]

TWO = PLAN.replace("\n[fit]", SHORT[SHORT.index("[[experiments]]") :].replace('"one"', '"two"') + "\n[fit]")
MODEL = "OpticalMetrology"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A campaign that extends another and has an FMU of its own, and the folder of its run."""
    home = tmp_path_factory.mktemp("home")
    (home / "base.toml").write_text(PLAN)
    shutil.copy(build.build([MODEL])[MODEL], home / "mine.fmu")
    (home / "plan.toml").write_text(f'extends = "base.toml"\nseed = 5\n[fmus.{MODEL}]\npath = "mine.fmu"\n')
    run = [sys.executable, "-m", "lpfcosim", "run", "plan.toml", "--out", "made", "--jobs", "1"]
    subprocess.run(run, cwd=home, check=True, capture_output=True)
    return home / "made"


@pytest.fixture
def copied(made, tmp_path):
    """A copy of that folder elsewhere; neither campaign nor FMU lie beside it."""
    return Path(shutil.copytree(made, tmp_path / "deep" / "copy"))


@pytest.mark.slow
def test_a_folder_holds_what_makes_it_again(made, copied, lpfcosim):
    plan = loading.load(copied / "campaign.toml")
    assert plan.digest == loading.load(made.parent / "plan.toml").digest
    assert plan.fit == loading.load(made.parent / "plan.toml").fit
    before = content(copied)
    out = lpfcosim("reproduce", copied, "--jobs", "2", "--trust", status=0)[1]
    told = [line.removeprefix(f"{copied}{os.sep}") for line in out.splitlines()]
    files = ("telemetry/one-noise.h5", "telemetry/one.h5", "results.json")
    assert told == [f"{name}: the same" for name in files]
    assert content(copied) == before
    # and for another way to run it, every byte of the folder
    lpfcosim("run", copied / "campaign.toml", "--out", "again", "--jobs", "2", status=0)
    assert content(Path("again")) == before


@pytest.mark.slow
def test_what_is_not_reproduced_is_told(copied, lpfcosim):
    telemetry, results = copied / "telemetry", copied / "results.json"
    data = bytearray((telemetry / "one.h5").read_bytes())
    data[len(data) // 2] ^= 1
    (telemetry / "one.h5").write_bytes(data)
    (telemetry / "one-noise.h5").rename(telemetry / "other.h5")
    document = json.loads(results.read_text())
    document["joint"]["chi2"] *= 1 + 1e-12
    results.write_text(json.dumps(document))
    _, out, err = lpfcosim("reproduce", copied, "--trust", status=1)
    told = [line.removeprefix(f"{copied}{os.sep}") for line in out.splitlines()]
    assert told == [
        "telemetry/one-noise.h5: is missing",
        "telemetry/one.h5: differs (same provenance)",
        "telemetry/other.h5: is no longer produced",
        "results.json: differs (joint)",
    ]
    assert err.splitlines()[-1].endswith("copy: 4 of 4 files are not reproduced")


def test_what_cannot_be_reproduced_is_refused(lpfcosim, copied, tmp_path):
    for folder, expected in (
        (tmp_path / "nowhere", r"nowhere: no such folder, expected the folder of an earlier run"),
        (copied, "telemetry: no telemetry, expected the folder of an earlier run"),
    ):
        shutil.rmtree(folder / "telemetry", ignore_errors=True)
        assert re.search(expected, refusal(lpfcosim("reproduce", folder)))


@pytest.mark.skipif(os.name != "posix", reason="the fault is one of POSIX")
@pytest.mark.slow
def test_a_run_that_fails_is_missing_in_the_report(lpfcosim, tmp_path):
    """The sysid run of the second experiment is the only one that lasts until the fault."""
    plan = tmp_path / "plan.toml"
    longer = TWO[::-1].replace('duration = "7200 s"'[::-1], 'duration = "7300 s"'[::-1], 2)[::-1]
    longer = longer.replace('noise_duration = "7300 s"', 'noise_duration = "7200 s"')
    plan.write_text(f'{longer}\n[fmus.{MODEL}]\npath = "bad.fmu"\n')
    faulty(build.build([MODEL])[MODEL], tmp_path / "bad.fmu", step=after(7250.0, SEGFAULT))
    err = lpfcosim("run", plan, "--trust", status=1)[2]
    why = rf"run 'two': the {MODEL} FMU crashed \(SIGSEGV, [^)]*\) at 7250\.0 s"
    last = err.splitlines()[-1]
    assert re.fullmatch(rf"lpfcosim: error: 1 of 4 runs failed, see plan.logs: {why}", last)
    assert "Traceback" not in err
    folder = tmp_path / "plan"
    assert {p.name for p in (folder / "telemetry").iterdir()} == {"one-noise.h5", "one.h5", "two-noise.h5"}
    assert "Fatal Python error" in (folder / "logs" / "two.log").read_text()
    document = json.loads((folder / "results.json").read_text())
    assert list(document["experiments"]) == ["one"]
    assert re.fullmatch(why, document["provenance"]["missing"]["two"])
    (warning,) = (w for w in document["joint"]["warnings"] if w["code"] == "missing_run")
    assert re.fullmatch(rf"experiment two is missing: {why}", warning["message"])
    assert "xperiment two is missing" in (folder / "report.html").read_text(encoding="utf-8")
