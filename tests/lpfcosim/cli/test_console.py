"""What is said of work that takes its time, where there are no bars."""

import pytest

from fit.parallel import update_progress
from lpfcosim.cli import console
from lpfcosim.cli.console import Console, WorkProgress


@pytest.fixture
def clock(monkeypatch):
    """Return a function that sets the time [s]."""
    now = [0.0]
    monkeypatch.setattr(console.time, "perf_counter", lambda: now[0])
    return lambda seconds: now.__setitem__(0, seconds)


@pytest.mark.parametrize(
    ("seconds", "done", "line"),
    [
        (4.0, 0.0, "fit: 4 s elapsed"),
        (4.0, 0.25, "fit: 25 %, about 12 s remaining"),
        (600.0, 0.5, "fit: 50 %, about 10 min remaining"),
        (7.0, 1.0, "fit: 7 s elapsed"),
    ],
)
def test_how_far_it_is_and_how_long_it_will_still_take(clock, seconds, done, line):
    work = WorkProgress("fit")
    clock(seconds)
    work.done = done
    assert work.line() == line


@pytest.mark.parametrize("quiet", [False, True])
def test_every_kind_of_work_says_so_unless_quiet(monkeypatch, capfd, quiet):
    monkeypatch.setattr(console, "FIRST_REPORT", 0.01)
    lines = []
    of_note = Console.note

    def note(self, line):
        of_note(self, line)
        lines.append(line)

    monkeypatch.setattr(Console, "note", note)
    shown = Console(quiet=quiet)

    def wait_for(words):
        while not quiet and not any(words in line for line in lines):
            pass

    with shown.stage("fit"):
        update_progress(0.5)
        wait_for("fit: 50 %")
    with shown.counted("campaigns", 10, 2) as advance:
        advance(4)
        wait_for("campaigns: 25 %")
    with shown.samples({"A": 100, "B": 300}) as (advance, keep):
        keep("B")
        advance("A", 10)
        wait_for("simulation: 10 %")
    said = capfd.readouterr().err
    assert (said == "") is quiet
    assert quiet or [line for line in said.splitlines() if line.startswith("campaigns: 4 in ")]
