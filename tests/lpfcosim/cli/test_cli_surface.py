"""The command line from outside: how it starts, helps and speaks JSON."""

import subprocess
import sys

import pytest

HEAVY = ("fmpy", "h5py", "lmfit", "matplotlib", "scipy", "sympy")


def python(code, *arguments, **options):
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True, **options
    )


# Start-up -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["--version"], ["run", "--help"], ["fmu", "list"], ["new", "mine.toml"], ["lunch"]],
)
def test_what_needs_no_numbers_reads_no_heavy_library(arguments, tmp_path):
    code = (
        "import sys, lpfcosim.cli\n"
        "try: lpfcosim.cli.main()\n"
        f"finally: print([m for m in {HEAVY} if m in sys.modules], file=sys.stderr)"
    )
    done = python(code, *arguments, cwd=tmp_path)
    assert done.stderr.splitlines()[-1] == "[]"


# Help -----------------------------------------------------------------------------------------------------
