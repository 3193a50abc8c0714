"""A call from Python needs nothing of its caller: neither a guard, nor a file, nor the main thread."""

import importlib.util
import os
import subprocess
import sys

import pytest

import lpfcosim
from tests import ROOT
from tests.lpfcosim.identification.test_identify import CAMPAIGN

pytestmark = pytest.mark.fmu

#: Statements of one line each, as a prompt takes them.
SIMULATE = """\
import lpfcosim
print("simulate", len(lpfcosim.simulate("short.toml", "simulated")), flush=True)
"""
OTHERS = """\
print("check", lpfcosim.check("short.toml") is not None, flush=True)
print("run", len(lpfcosim.run("short.toml", "out").telemetry), flush=True)
print("montecarlo", lpfcosim.montecarlo("short.toml", 2, "montecarlo").n, flush=True)
print("identify", len(lpfcosim.identify("short.toml", out="out").results.joint.parameters), flush=True)
print("design", lpfcosim.design("short.toml", "designed.toml") is not None, flush=True)
"""
NOTEBOOK = """
import nbformat
from nbclient import NotebookClient
cells = [nbformat.v4.new_code_cell(line) for line in open("script.py")]
done = NotebookClient(nbformat.v4.new_notebook(cells=cells), timeout=600).execute()
print("".join(out.text for cell in done.cells for out in cell.outputs if out.name == "stdout"))
"""
THREAD = """
import runpy, threading
thread = threading.Thread(target=runpy.run_path, args=("script.py",))
thread.start()
thread.join()
"""
#: Arguments of Python, what its standard input holds, and the module that is needed.
CALLERS = {
    "script": (["script.py"], "", ""),
    "standard input": (["-"], "{code}", ""),
    "prompt": (["-i"], "{code}", ""),
    "thread": (["-c", THREAD], "", ""),
    "IPython": (["-m", "IPython", "script.py"], "", "IPython"),
    "notebook": (["-c", NOTEBOOK], "", "nbclient"),
}


@pytest.fixture(scope="module")
def digests(tmp_path_factory):
    """The digests of telemetry that this very process had simulated."""
    folder = tmp_path_factory.mktemp("callers")
    (folder / "short.toml").write_text(CAMPAIGN)
    lpfcosim.simulate(folder / "short.toml", folder)
    return (folder / "telemetry.sha256").read_text()


def call(caller, code, folder):
    """Return what the caller prints."""
    arguments, standard_input, module = CALLERS[caller]
    if module and not importlib.util.find_spec(module):
        pytest.skip(f"needs {module}")
    (folder / "script.py").write_text(code)
    (folder / "short.toml").write_text(f"{CAMPAIGN}\n[identify]\nlambda_2 = {{}}\nC_2 = {{}}\n")
    command = [sys.executable, *(argument.replace("{code}", code) for argument in arguments)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(
        command,
        cwd=folder,
        input=standard_input.replace("{code}", code),
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
        env=environment,
    )
    assert "Traceback" not in done.stderr
    return done.stdout


@pytest.mark.parametrize("caller", ["script", "standard input"])
def test_telemetry_is_the_same_from_every_caller(caller, digests, tmp_path):
    assert call(caller, SIMULATE, tmp_path) == "simulate 2\n"
    assert (tmp_path / "simulated" / "telemetry.sha256").read_text() == digests


@pytest.mark.slow
@pytest.mark.parametrize("caller", CALLERS)
def test_every_function_works_from_every_caller(caller, digests, tmp_path):
    printed = call(caller, SIMULATE + OTHERS, tmp_path).split("\n")
    expected = ["simulate 2", "check True", "run 2", "montecarlo 2", "identify 2", "design True"]
    assert [line for line in printed if line in expected] == expected
    assert (tmp_path / "simulated" / "telemetry.sha256").read_text() == digests
