"""A campaign of hundreds of experiments is checked in seconds and in little memory."""

import os
import subprocess
import sys

import pytest

MEGABYTES = 300.0
SECONDS = 60.0  # of the processor; a free one takes a quarter of it
CODE = r"""
import re, resource, sys
from pathlib import Path
sys.argv = ["lpfcosim", "check", "many.toml", "--quiet"]
from lpfcosim.cli import main
try:
    main()
finally:
    used = resource.getrusage(resource.RUSAGE_SELF)
    peak = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())[1]
    print(used.ru_utime + used.ru_stime, int(peak) / 1024)
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="other systems count memory in another way")
def test_five_hundred_experiments(quickstart, tmp_path):
    head, *tables = quickstart.read_text().split("[[experiments]]")
    for i in range(500):
        table = tables[i % 4].replace('name = "', f'name = "E{i}')
        head += "[[experiments]]" + table.replace('duration = "6 h"', f'duration = "{21600 + i} s"', 1)
    (tmp_path / "many.toml").write_text(head)
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-P", "-c", CODE],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    seconds, megabytes = map(float, done.stdout.split())
    assert megabytes < MEGABYTES
    assert seconds < SECONDS
