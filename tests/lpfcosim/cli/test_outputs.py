"""Where results cannot be written is said before any work is done."""

import pytest

from lpfcosim.modelica import build
from tests import ROOT
from tests.lpfcosim.cli.refusal import refusal


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A campaign that extends another, a file and a folder; nothing may be forecast or built."""
    monkeypatch.setattr(build, "build", None)
    monkeypatch.setattr("lpfcosim.workflows.forecast.planned_experiments", None)
    monkeypatch.setattr("lpfcosim.experiment_design.fit_model.planned_experiments", None)
    base = (ROOT / "campaigns" / "quickstart.toml").read_text(encoding="utf-8")
    (tmp_path / "base.toml").write_text(base, encoding="utf-8")
    (tmp_path / "mine.toml").write_text('extends = "base.toml"\nname = "mine"\n', encoding="utf-8")
    (tmp_path / "file").write_text(base, encoding="utf-8")
    (tmp_path / "notes.toml").touch()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.toml").symlink_to(tmp_path / "base.toml")
    return tmp_path


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("design mine.toml --out base.toml", "base.toml: is read by this command, expected"),
        ("design mine.toml --out out/mine.toml", "out/mine.toml: is read by this command, expected"),
        ("design mine.toml --out notes.toml", "notes.toml: is there already and is no design, expected"),
        ("forecast mine.toml --out file", "file: cannot be made in or written to, expected a folder"),
        ("new base.toml", "base.toml: exists already, expected a new name"),
        ("new my|own.toml", 'my|own.toml: "my|own" cannot name a file'),
    ],
)  # fmt: skip
def test_output_that_cannot_be_is_refused_first(lpfcosim, mine, command, sentence):
    before = {path: path.stat().st_mtime_ns for path in mine.rglob("*")}
    assert refusal(lpfcosim(*command.split())).startswith(sentence)
    assert {path: path.stat().st_mtime_ns for path in mine.rglob("*")} == before
