"""The command line: exit statuses, one sentence for bad input, and the files it leaves."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import runner, telemetry_file
from lpfcosim.modelica import build as fmu_build
from tests.campaign_text import campaign
from tests.reference_run import simulate_reference

SHORT = campaign(
    'duration = "7200 s"\nnoise_duration = "7200 s"',
    ("guidance_o_12", "3 mHz", "10 nm", 8, "900 s"),
    ("guidance_o_1", "10 mHz", "5 nm", 20, "4000 s"),
    ("guidance_o_12", "0.8 mHz", "80 nm", 3, "3400 s"),
    name="short",
    seed=3,
)


@pytest.fixture
def short(tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(SHORT)
    return file


@pytest.fixture
def recorded(short, tmp_path):
    """Folder with the telemetry of the short campaign, from the reference plant."""
    folder = tmp_path / "recorded"
    folder.mkdir()
    for run in loading.load(short).runs:
        channels = {k: v for k, v in simulate_reference(run).items() if k in telemetry_file.CHANNELS}
        with telemetry_file.create(folder / f"{run.name}.h5", run, channels, {}) as file:
            file.append(channels)
    return folder


def test_fit_then_report(lpfcosim, recorded, tmp_path):
    before = sorted(p.name for p in recorded.iterdir())
    out = lpfcosim("fit", recorded, "--include-short", status=0)[1]
    assert sorted(p.name for p in recorded.iterdir()) == before  # the folder by default is another one
    result = tmp_path / "recorded-fit"
    assert str(result.name) in out
    document = json.loads((result / "results.json").read_text())
    assert document["schema"] == "lpf-results/1"
    assert abs(document["joint"]["parameters"]["lambda_2"]["pull"]) < 4
    page = (result / "report.html").read_text(encoding="utf-8")
    (result / "report.html").unlink()
    lpfcosim("report", result, status=0)
    assert 'id="agreement"' in page
    assert (result / "report.html").read_text(encoding="utf-8").split() == page.split()


@pytest.mark.fmu
def test_run_leaves_what_the_contract_says(lpfcosim, short, tmp_path):
    _, out, err = lpfcosim("run", short, "--jobs", "2", status=0)
    folder = tmp_path / "short"
    promised = {"telemetry", "results.json", "report.html"}
    ours = {"campaign.toml", "telemetry.sha256", ".lock"}
    assert {p.name for p in folder.iterdir()} == promised | ours
    assert {p.name for p in (folder / "telemetry").iterdir()} == {"one.h5", "one-noise.h5"}
    document = json.loads((folder / "results.json").read_text())
    assert document["provenance"]["campaign"] == "short"
    assert "fmu_Plant" in document["provenance"]
    assert "report.html" in out
    assert "run one: 2 h" in err
    # nothing is simulated twice
    stamps = [p.stat().st_mtime_ns for p in (folder / "telemetry").iterdir()]
    err = lpfcosim("run", short, status=0)[2]
    assert "run one: kept" in err
    assert "simulation: 0 h" in err
    assert [p.stat().st_mtime_ns for p in (folder / "telemetry").iterdir()] == stamps


@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [
        (InputError("plant.fmu: no"), 2, "plant.fmu: no"),
        (RunError("run 'one' diverges"), 1, "run 'one' diverges"),
        (OSError(28, "No space left on device", "one.h5"), 1, "one.h5: No space left on device"),
        (signal.SIGINT, 1, "interrupted; what is finished is kept, the same command continues"),
        (signal.SIGTERM, 1, "interrupted; what is finished is kept, the same command continues"),
    ],
)
def test_what_fails_is_one_sentence_and_a_status(lpfcosim, short, monkeypatch, error, status, sentence):
    def fail(*_, **__):
        if isinstance(error, Exception):
            raise error
        os.kill(os.getpid(), error)
        time.sleep(5)

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(fmu_build, "build", lambda *_, **__: {})
    monkeypatch.setattr(runner, "read_interfaces", lambda *_: [])
    monkeypatch.setattr(runner, "simulate", fail)
    try:
        assert lpfcosim("run", short, "--quiet") == (status, "", f"lpfcosim: error: {sentence}\n")
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.fmu
@pytest.mark.skipif(os.name != "posix", reason="a terminal sends SIGINT to a process group on POSIX")
@pytest.mark.slow
def test_interrupt_ends_everything_at_once(short, tmp_path):
    """Ctrl-C in a terminal reaches the workers too; neither they nor their files stay."""
    short.write_text(SHORT.replace("7200 s", "65 h"))
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    process = subprocess.Popen(
        [sys.executable, "-m", "lpfcosim", "run", short, "--jobs", "2"],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(scratch)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        while len(list(tmp_path.glob("short/telemetry/.*.part"))) < 2:
            assert process.poll() is None, process.communicate()[1]
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=30)  # until nobody holds its standard error
        assert process.returncode == 1
        assert "Traceback" not in err
        last = "lpfcosim: error: interrupted; what is finished is kept, the same command continues"
        assert err.splitlines()[-1] == last
        assert list((tmp_path / "short" / "telemetry").iterdir()) == []
        assert list(scratch.iterdir()) == []
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
