"""What was measured comes into the documentation, between its marks and nowhere else."""

import json
import sys

from tests.benchmarks import waiting

TOOK = {"s": 1.25, "cpu": 2.0, "mb": 200.0, "mb_all": 300.0}
STAGES = dict.fromkeys(waiting.STAGES, TOOK)
TOLD = {
    "machine": "2 processors",
    "campaigns": {"quickstart": STAGES, "mission-x": {**STAGES, "total": {**TOOK, "s": 12.34}}},
    "commands": {"fit": {"total": TOOK}},
    "loaded": "quickstart",
    "load": {"one_processor_s": 5.0, "one_thread_ratio": 1.11, "default_ratio": 1.22},
    "ratios": {"quickstart": {"total": 3.0, "cpu": 2.5}},
}


def test_figures_come_between_their_marks(tmp_path, monkeypatch, capsys):
    (tmp_path / "docs").mkdir()
    pages = [tmp_path / "README.md", tmp_path / "docs" / "benchmarks.md"]
    for page in pages:
        page.write_text(f"before\n{waiting.BEGIN}\nold\n{waiting.END}\nafter\n")
    told = tmp_path / "told"
    told.write_text("a table\n" + json.dumps(TOLD) + "\n")
    monkeypatch.setattr(waiting, "ROOT", tmp_path)
    monkeypatch.setattr(sys, "argv", ["waiting.py", "--told", str(told), "--docs"])
    waiting.main()
    assert json.loads(capsys.readouterr().out.splitlines()[-1]) == TOLD
    readme, page = (page.read_text() for page in pages)
    for text in (readme, page):
        assert text.startswith(f"before\n{waiting.BEGIN}\n")
        assert text.endswith(f"{waiting.END}\nafter\n")
        assert "old" not in text
    assert "`quickstart` 1 s, `mission-x` 12 s" in readme
    assert "| 12.3 s, 200 MB | 300 MB |" in page
    assert "1.22 times as long" in page
    assert "| `quickstart` | 3.0 | 2.5 |" in page


def test_ratios_are_told_on_the_clock_and_in_processor_time():
    before = {"fit": TOOK, "total": {**TOOK, "s": 10.0, "cpu": 5.0}}
    now = {"fit": {**TOOK, "s": 0.5}, "total": TOOK, "build": TOOK}
    assert waiting.ratios(before, now) == {"fit": 2.5, "total": 8.0, "cpu": 2.5}
