"""The command line: exit statuses, one sentence for bad input, and the files it leaves."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import runner
from lpfcosim.modelica import build
from tests.campaign_text import campaign

SHORT = campaign(
    'duration = "7200 s"\nnoise_duration = "7200 s"',
    ("guidance_o_12", "3 mHz", "10 nm", 8, "900 s"),
    ("guidance_o_1", "10 mHz", "5 nm", 20, "4000 s"),
    ("guidance_o_12", "0.8 mHz", "80 nm", 3, "3400 s"),
    name="short",
    seed=3,
)
HEAVY = ("fmpy", "h5py", "lmfit", "matplotlib", "scipy", "sympy")


@pytest.fixture
def short(tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(SHORT)
    return file


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
    assert abs(document["experiments"]["one"]["parameters"]["lambda_2"]["pull"]) < 4
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
    monkeypatch.setattr(build, "build", lambda *_, **__: {})
    monkeypatch.setattr(runner, "simulate", fail)
    try:
        assert lpfcosim("run", short, "--quiet") == (status, "", f"lpfcosim: error: {sentence}\n")
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("chek short.toml", "no such command 'chek', did you mean 'check'"),
        ("run short.toml --jobs two", "invalid value for '--jobs': it should be a valid integer"),
        ("fmu build Rocket", 'no model "Rocket"'),
        ("report .", ".: no results.json in it, expected the folder of an earlier run or fit"),
        ("forecast short.toml --out short.toml", "short.toml: cannot be made in or written to, expected a f"),
        ("new short.toml", "short.toml: exists already, expected a new name"),
    ],
)
@pytest.mark.usefixtures("short")
def test_a_mistake_is_one_sentence_and_nothing_is_written(refusal, tmp_path, command, sentence):
    assert refusal(*command.split()).startswith(sentence)
    assert [path.name for path in tmp_path.iterdir()] == ["short.toml"]


def test_a_design_replaces_no_file_but_a_design(refusal, tmp_path, monkeypatch):
    monkeypatch.setattr("lpfcosim.experiment_design.fit_model.planned_experiments", None)
    (tmp_path / "base.toml").write_text(SHORT)
    (tmp_path / "mine.toml").write_text('extends = "base.toml"\nname = "mine"\n')
    (tmp_path / "notes.toml").touch()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.toml").symlink_to(tmp_path / "base.toml")
    for out in ("base.toml", "out/mine.toml"):
        assert refusal("design", "mine.toml", "--out", out).startswith(f"{out}: is read by this command")
    assert "is there already and is no design" in refusal("design", "mine.toml", "--out", "notes.toml")


@pytest.mark.parametrize(
    "arguments",
    [["--version"], ["run", "--help"], ["fmu", "list"], ["new", "mine.toml"], ["lunch"]],
)
def test_what_needs_no_numbers_reads_no_heavy_library(arguments, tmp_path):
    code = (
        "import sys, lpfcosim.cli\n"
        "try: lpfcosim.cli.main()\n"
        f"finally: print([m for m in {HEAVY} if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code, *arguments], stderr=-1, text=True, cwd=tmp_path)
    assert done.stderr.splitlines()[-1] == "[]"


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
