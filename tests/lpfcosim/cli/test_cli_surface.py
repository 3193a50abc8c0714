"""The command line from outside: how it starts, helps and speaks JSON."""

import os
import subprocess
import sys

import pytest

GROUPS = {
    (): "new check forecast run montecarlo design identify "
    "fit report figures deltag compare jitter ttl mcmc fmu",
    ("fmu",): "build list export-ssp",
}
COMMANDS = [(*group, name) for group, names in GROUPS.items() for name in names.split()]
HEAVY = ("fmpy", "h5py", "lmfit", "matplotlib", "scipy", "sympy")


def python(code, *arguments, **options):
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True, **options
    )


CONTINUES = "what is finished is kept, the same command continues"


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


@pytest.mark.skipif(os.name != "posix", reason="elsewhere a process cannot interrupt itself")
@pytest.mark.parametrize(
    ("module", "arguments", "message"),
    [
        ("typer", ["--help"], "interrupted"),
        ("scipy", ["forecast", "one.toml"], "interrupted"),
        ("typer", ["montecarlo", "one"], f"interrupted; {CONTINUES}"),
    ],
)
def test_interrupt_while_it_starts_is_one_sentence(module, arguments, message, tmp_path):
    interrupting = "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(5)\n"
    (tmp_path / f"{module}.py").write_text(interrupting)
    done = python(
        "from lpfcosim.cli import main; main()",
        *arguments,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])},
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"lpfcosim: error: {message}\n"


# Help -----------------------------------------------------------------------------------------------------


def test_help_fits_and_has_an_example(lpfcosim, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for command in COMMANDS:
        status, out, err = lpfcosim(*command, "--help")
        assert (status, err) == (0, "")
        assert max(map(len, out.splitlines())) <= 80
        assert f"\n    lpfcosim {' '.join(command)}" in out.split("Examples:")[1]
