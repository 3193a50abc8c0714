"""A campaign that is killed, or runs out of disk, goes on where it was and ends as if nothing had happened.

    pytest -m slow tests/hostile/test_resume.py --kills 100    kills at times uniform over the whole run

Every kill is a SIGKILL of the whole process group: nobody is left to tidy up, as after a power cut (but for
what the operating system has not written yet, which fsync is for and which is not tested here).
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.lpfcosim.cli.test_cli import SHORT

pytestmark = [
    pytest.mark.fmu,
    pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL and setrlimit"),
    pytest.mark.slow,
]

PLAN = (
    SHORT.replace("noise_duration", 'sample_rate = "2 Hz"\nnoise_duration')
    + "\n[fit]\ninclude_short = true\n"
)

MADE = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d UTC</")


def content(folder):
    """The bytes of the files in a folder, but for the time at which a report was made."""
    return {
        p.relative_to(folder).as_posix(): MADE.sub(b"", p.read_bytes())
        if p.suffix == ".html"
        else p.read_bytes()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and p.name != ".lock"
    }


def command(folder, *options):
    campaign = str(folder.parent / "short.toml")
    return [sys.executable, "-m", "lpfcosim", "run", campaign, "--out", str(folder), "--jobs", "1", *options]


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Folder with the campaign file and a place for temporary files."""
    folder = tmp_path_factory.mktemp("home")
    (folder / "short.toml").write_text(PLAN)
    (folder / "tmp").mkdir()
    return folder


@pytest.fixture(scope="module")
def undisturbed(home):
    """Content of the folder, by path, of a run that nothing happens to."""
    timed(home / "sound")  # the first waits for the disk
    return content(home / "sound")


def timed(folder):
    """Run the command to its end; return the seconds it takes."""
    shutil.rmtree(folder, ignore_errors=True)
    begun = time.monotonic()
    subprocess.run(command(folder), check=True, capture_output=True)
    return time.monotonic() - begun


def kill(folder, home, seconds):
    """Kill the command with all its processes after some seconds, unless it was faster."""
    environment, devnull = {**os.environ, "TMPDIR": str(home / "tmp")}, subprocess.DEVNULL
    process = subprocess.Popen(
        command(folder), env=environment, stdout=devnull, stderr=devnull, start_new_session=True
    )
    with suppress(subprocess.TimeoutExpired):
        process.wait(seconds)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@pytest.mark.slow
def test_killed_at_any_moment(home, undisturbed, request, lpfcosim):
    kills, seconds = request.config.getoption("--kills"), timed(home / "timed")
    for k in range(kills):
        folder = home / f"killed-{k}"
        kill(folder, home, (k + 0.5) / kills * seconds)
        files = content(folder) if folder.is_dir() else {}
        finished = {n for n in files if not any(p.startswith((".", "logs")) for p in Path(n).parts)}
        for name in finished - {"telemetry.sha256"}:  # what looks finished is
            assert files[name] == undisturbed[name], f"{name} after kill {k}"
        known = files.get("telemetry.sha256", b"").decode()
        kept = [folder / n for n in finished if n.startswith("telemetry/") and n in known]
        stamps = {path: path.stat().st_mtime_ns for path in kept}
        err = lpfcosim("run", home / "short.toml", "--out", folder, status=0)[2]
        for path, stamp in stamps.items():  # not simulated again
            assert f"run {path.stem}: kept" in err
            assert path.stat().st_mtime_ns == stamp
        assert content(folder) == undisturbed, f"after kill {k}"
        assert not (folder / "logs").exists()
        assert not list((home / "tmp").glob("lpfcosim-*"))
        shutil.rmtree(folder)


@pytest.mark.parametrize(
    "limit",
    [pytest.param(100, marks=pytest.mark.slow), 200_000, pytest.param(900_000, marks=pytest.mark.slow)],
)
def test_a_full_disk(home, undisturbed, lpfcosim, limit):
    """A limit on the size of files stands in for a disk that is full: writes fail half-way."""
    import resource

    folder = home / f"full-{limit}"
    done = subprocess.run(
        command(folder, "--quiet"),
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == 1
    assert re.search("^lpfcosim: error: .*(cannot be written|File too large)", done.stderr, re.MULTILINE)
    left = content(folder)
    assert all(undisturbed[n] == b for n, b in left.items() if n.startswith(("telemetry/", "results")))
    assert not [n for n in left if Path(n).name.startswith(".")]
    lpfcosim("run", home / "short.toml", "--out", folder, status=0)
    assert content(folder) == undisturbed
