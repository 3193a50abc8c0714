"""The benchmark works; what it measures is for people to read, not for a test to judge."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.fmu, pytest.mark.long]


def test_short_benchmark_works():
    script = Path(__file__).with_name("engine.py")
    done = subprocess.run([sys.executable, script, "--short"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout.splitlines()[-1])
    for parts in figures["parts"].values():
        assert set(parts) == {"step", "arithmetic", "calls and exchange", "recording", "noise", "file"}
    assert all(value > 0 for value in figures["peak_mb"].values())
