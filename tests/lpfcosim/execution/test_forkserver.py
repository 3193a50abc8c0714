"""Workers come from somewhere, whatever becomes of the server that reads in libraries for them."""

import importlib
import importlib.util
import os
import pickle
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from lpfcosim.execution import forkserver
from lpfcosim.modelica import build

SCRIPT = """
from lpfcosim.execution import forkserver
forkserver.preload()  # as the command line does
print(forkserver.context().get_start_method())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="there is no such server elsewhere")
@pytest.mark.parametrize(("folder", "method"), [("", "forkserver"), ("long" * 30, "spawn")])
def test_a_folder_with_a_long_path_for_temporary_files_is_no_hindrance(tmp_path, folder, method):
    temporary = tmp_path / folder if folder else Path(tempfile.gettempdir())
    temporary.mkdir(exist_ok=True)
    env = {**os.environ, "TMPDIR": str(temporary)}
    made = subprocess.run([sys.executable, "-c", SCRIPT], env=env, capture_output=True, text=True, check=True)
    assert made.stdout.strip() == method


INTERRUPTED = """
import os, signal
from multiprocessing import forkserver as standard
from lpfcosim.execution import forkserver
forkserver.preload()
server = standard._forkserver._forkserver_pid
os.kill(server, signal.SIGINT)
child = forkserver.context().Process(target=os.kill, args=(0, signal.SIGINT))
handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
child.start()
child.join()
signal.signal(signal.SIGINT, handler)
print(child.exitcode, standard._forkserver._forkserver_pid == server, handler is signal.default_int_handler)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="there is no such server elsewhere")
def test_an_interrupt_of_the_process_group_ends_neither_server_nor_worker():
    command = [sys.executable, "-c", INTERRUPTED]
    done = subprocess.run(command, capture_output=True, text=True, check=True, start_new_session=True)
    assert (done.stdout, done.stderr) == ("0 True True\n", "")


@pytest.mark.parametrize("name", [*forkserver.LIBRARIES, *forkserver.FITTING])
def test_what_workers_need_is_there(name):
    importlib.import_module(name)  # the server says nothing of what it does not find


TASK = """
import pathlib, pickle, sys
from lpfcosim.execution import runner
place = pathlib.Path(sys.argv[1])
runner.write_telemetry(*pickle.loads(place.read_bytes()), place.with_suffix(".h5"), {})
print(*sys.modules)
"""


@pytest.mark.fmu
@pytest.mark.parametrize("rate", [10.0, 1.0])
def test_to_simulate_imports_nothing_of_a_fit(make_run, tmp_path, rate):
    task = tmp_path / "task"
    task.write_bytes(pickle.dumps((make_run(n_samples=12_000, sample_rate=rate), build.build())))
    done = subprocess.run([sys.executable, "-c", TASK, str(task)], capture_output=True, text=True, check=True)
    assert "lmfit" not in set(done.stdout.split())
