"""The command line: exit statuses, one sentence for bad input, and the files it leaves."""

import json
import re
import subprocess
import sys

import pytest

from lpfcosim import campaign, cli, reference, telemetry

SHORT = """
schema = "lpf-campaign/1"
name = "short"
seed = 3

[noise]
oms = "35 fm Hz^-0.5"
thruster = "0.15 uN Hz^-0.5"
plateau = "5.6 fm s^-2 Hz^-0.5"
tail = 1.5

[authority.A]
F_max_1 = "0 pN"
F_max_2 = "2200 pN"
N_max_1 = "10.4 pN m"
N_max_2 = "10.4 pN m"

[[experiments]]
name = "one"
authority = "A"
alignment_epoch = 1
duration = "7200 s"
noise_duration = "7200 s"

[[experiments.injections]]
into = "guidance_o_12"
shape = "sine"
frequency = "3 mHz"
amplitude = "10 nm"
cycles = 8
start = "900 s"

[[experiments.injections]]
into = "guidance_o_1"
shape = "sine"
frequency = "10 mHz"
amplitude = "5 nm"
cycles = 20
start = "4000 s"
"""


@pytest.fixture
def short(tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(SHORT)
    return file


@pytest.fixture
def lpfcosim(monkeypatch, capfd, tmp_path):
    """Run the command line in ``tmp_path``; returns (status, standard output, standard error)."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["lpfcosim", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        captured = capfd.readouterr()
        return stopped.value.code or 0, captured.out, captured.err

    return run


@pytest.fixture
def recorded(short, tmp_path):
    """Folder with the telemetry of the short campaign, from the reference plant."""
    folder = tmp_path / "recorded"
    folder.mkdir()
    for run in campaign.load(short).runs:
        channels = {k: v for k, v in reference.simulate(run).items() if k in telemetry.CHANNELS}
        telemetry.write(folder / f"{run.name}.h5", run, channels, {})
    return folder


def test_fit_then_report(lpfcosim, recorded, tmp_path):
    status, out, err = lpfcosim("fit", recorded, "--include-short", "--out", "result")
    assert status == 0, err
    result = tmp_path / "result"
    assert str(result.name) in out
    document = json.loads((result / "results.json").read_text())
    assert document["schema"] == "lpf-results/1"
    assert abs(document["joint"]["parameters"]["lambda_2"]["pull"]) < 4
    page = (result / "report.html").read_text(encoding="utf-8")
    (result / "report.html").unlink()
    status, _, err = lpfcosim("report", "result")
    assert status == 0, err
    assert (result / "report.html").read_text(encoding="utf-8") == page


def test_default_folder_never_covers_the_input(lpfcosim, recorded, tmp_path):
    before = sorted(p.name for p in recorded.iterdir())
    status, _, err = lpfcosim("fit", recorded, "--include-short", "--quiet")
    assert (status, err) == (0, "")
    assert sorted(p.name for p in recorded.iterdir()) == before
    assert (tmp_path / "recorded-fit" / "report.html").is_file()


@pytest.mark.fmu
def test_run_leaves_what_the_contract_says(lpfcosim, short, tmp_path):
    status, out, err = lpfcosim("run", short, "--jobs", "2")
    assert status == 0, err
    folder = tmp_path / "short"
    assert {p.name for p in folder.iterdir()} == {"telemetry", "results.json", "report.html", "figures"}
    assert {p.name for p in (folder / "telemetry").iterdir()} == {"one.h5", "one-noise.h5"}
    document = json.loads((folder / "results.json").read_text())
    assert document["provenance"]["campaign"] == "short"
    assert "fmu_Plant" in document["provenance"]
    assert "report.html" in out
    # nothing is simulated twice
    stamps = [p.stat().st_mtime_ns for p in (folder / "telemetry").iterdir()]
    assert lpfcosim("run", short)[0] == 0
    assert [p.stat().st_mtime_ns for p in (folder / "telemetry").iterdir()] == stamps


@pytest.mark.fmu
def test_fmu_commands(lpfcosim, tmp_path):
    status, out, _ = lpfcosim("fmu", "build", "--out", "here")
    assert status == 0
    assert len(list((tmp_path / "here").glob("*.fmu"))) == 5
    status, out, _ = lpfcosim("fmu", "list")
    assert status == 0
    assert out.count("built") == 5
    assert "not built" not in out
    status, out, _ = lpfcosim("fmu", "validate", "here/Plant.fmu")
    assert status == 0
    assert "no fault found" in out
    status, _, err = lpfcosim("fmu", "build", "Rocket")
    assert status == 2
    assert "no model 'Rocket'" in err


def one_sentence(err: str) -> str:
    lines = err.strip().splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith("lpfcosim: error: ")
    return lines[0]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (("frequency = \"10 mHz\"", "frequency = \"10 nm\""), r"experiments\[0\]\.injections\[1\]\.frequency: "),
        (("frequency = \"10 mHz\"", "frequency = \"8 Hz\""), r"experiments\[0\]\.injections\[1\]\.frequency: .*Nyquist"),
        (("cycles = 20", "cycles = 2000"), r"experiments\[0\]\.injections\[1\]"),
        (("authority = \"A\"", "authority = \"Z\""), r"experiments\[0\]\.authority: .*Z"),
        (("amplitude = \"5 nm\"", "amplitude = \"-5 nm\""), r"experiments\[0\]\.injections\[1\]\.amplitude: "),
        (("seed = 3", "sede = 3"), r"sede"),
        (("seed = 3", "seed = "), r"short\.toml"),
        (("plateau = \"5.6 fm s^-2 Hz^-0.5\"", "plateau = 5.6e-15"), r"noise\.plateau: "),
        (("[authority.A]", "[control.suspension]\nunity_gain = \"0.5 Hz\"\n[authority.A]"), r"pole"),
    ],
)  # fmt: skip
def test_bad_campaign_is_one_sentence_and_leaves_nothing(lpfcosim, short, tmp_path, change, expected):
    assert change[0] in SHORT
    short.write_text(SHORT.replace(*change))
    status, out, err = lpfcosim("run", short)
    assert status == 2
    assert re.search(expected, one_sentence(err))
    assert out == ""
    assert [p.name for p in tmp_path.iterdir()] == ["short.toml"]


def test_bad_paths(lpfcosim, tmp_path):
    for arguments in (("run", "nowhere.toml"), ("fit", "nowhere"), ("report", "nowhere")):
        status, _, err = lpfcosim(*arguments)
        assert status == 2, arguments
        assert "nowhere" in one_sentence(err)
    (tmp_path / "noise.h5").write_bytes(b"no telemetry")
    status, _, err = lpfcosim("fit", "noise.h5")
    assert status == 2
    assert "noise.h5" in one_sentence(err)


def test_wrong_usage_is_status_2_and_help_is_there():
    for arguments, status in (
        (["run"], 2),
        (["launch"], 2),
        (["--help"], 0),
        (["run", "--help"], 0),
        (["fmu", "--help"], 0),
    ):
        done = subprocess.run([sys.executable, "-m", "lpfcosim", *arguments], capture_output=True, text=True)
        assert done.returncode == status, arguments
        assert "Traceback" not in done.stderr
