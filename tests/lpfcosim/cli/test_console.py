"""Progress of work that takes its time, in a terminal and in a log."""

import pytest

from lpfcosim.cli import console
from lpfcosim.cli.console import Console


@pytest.fixture
def clock(monkeypatch):
    """Return a function that sets the time [s]."""
    now = [0.0]
    monkeypatch.setattr(console.time, "perf_counter", lambda: now[0])
    return lambda seconds: now.__setitem__(0, seconds)


def test_log_sees_plain_lines_and_the_time_left(clock, capsys):
    console = Console()
    with console.samples({"A": 36_000, "B": 36_000}) as (progress, kept):
        kept("A")
        clock(3.0)
        progress("B", 9_000)
        clock(4.0)
        progress("B", 18_000)
        progress("B", 36_000)
    with console.counted("steps", 10) as progress:
        progress(7)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "run A: kept",
        "simulation: 25 %, about 9 s remaining",
        "run B: 1 h",
        "simulation: 1 h in 4.0 s",
        "steps: 7 in 0.0 s",
    ]
