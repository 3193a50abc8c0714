"""What was measured comes into the documentation, between its marks and nowhere else."""

import json
import sys

import pytest

from tests.benchmarks import waiting

MEASURED = {
    "machine": "2 processors",
    "figures": {
        "run quickstart": {"s": 1.25, "cpu": 2.0, "mb": 200.0},
        "run mission-x": {"s": 12.34, "cpu": 2.0, "mb": 200.0},
        "start": {"s": 0.11, "cpu": 0.1, "mb": 17.0},
    },
}


def test_figures_come_between_their_marks(tmp_path, monkeypatch, capsys):
    (tmp_path / "docs").mkdir()
    pages = [tmp_path / "README.md", tmp_path / "docs" / "benchmarks.md"]
    for page in pages:
        page.write_text(f"before\n{waiting.BEGIN}\nold\n{waiting.END}\nafter\n")
    log = tmp_path / "log"
    log.write_text("a table\n" + json.dumps(MEASURED) + "\n")
    monkeypatch.setattr(waiting, "ROOT", tmp_path)
    monkeypatch.setattr(sys, "argv", ["waiting.py", "--json", str(log), "--docs"])
    waiting.main()
    assert json.loads(capsys.readouterr().out.splitlines()[-1]) == MEASURED
    readme, page = (page.read_text() for page in pages)
    for text in (readme, page):
        assert text.startswith(f"before\n{waiting.BEGIN}\n")
        assert text.endswith(f"{waiting.END}\nafter\n")
        assert "old" not in text
    assert "`quickstart` 1 s, `mission-x` 12 s.\n" in readme
    assert "| `run mission-x` | 12.3 s, 200 MB |" in page


def test_a_command_is_measured(tmp_path):
    figures = waiting.measure(["--version"], tmp_path)
    assert 0 < figures["cpu"] < 60
    assert figures["mb"] > 5  # a child begins with the peak of its parent, here that of the tests
    with pytest.raises(SystemExit, match="status 2"):
        waiting.measure(["no-such-command"], tmp_path)
