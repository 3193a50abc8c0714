"""Progress of work that takes its time, in a terminal and in a log."""

import pytest

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


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")


def test_terminal_sees_the_time_left(terminal, clock, capsys):
    console = Console()
    with console.counted("campaigns", 10, 4) as progress:
        progress(5)
    with console.samples({"A": 36_000, "B": 36_000}) as (progress, kept):
        kept("A")
        progress("B", 18_000)
    with console.stage("fit"):
        pass
    out, err = capsys.readouterr()
    assert out == ""
    for shown in ("5/10", "-:--:--", "simulation", " 50 %", "fit", "0:00:00"):
        assert shown in err
    assert "campaigns: 5 in 0.0 s\n" in err
    assert "simulation: 1 h (1 runs kept) in 0.0 s\n" in err


def test_log_sees_plain_lines(clock, capsys):
    console = Console()
    with console.samples({"A": 36_000, "B": 36_000}) as (progress, kept):
        kept("A")
        progress("B", 18_000)
        progress("B", 36_000)
    with console.counted("steps", 10) as progress:
        progress(7)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == ["run A: kept", "run B: 1 h", "simulation: 1 h in 0.0 s", "steps: 7 in 0.0 s"]
