"""Workers come from somewhere, whatever becomes of the server that reads in libraries for them."""

import importlib
import importlib.util
import multiprocessing.context
import os
import pickle
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from lpfcosim.execution import forkserver
from lpfcosim.modelica import build

SCRIPT = "from lpfcosim.execution import forkserver as n; n.preload(); print(n.context().get_start_method())"


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
child = forkserver.context().Process(target=int)
child.start()
child.join()
print(child.exitcode, standard._forkserver._forkserver_pid == server)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="there is no such server elsewhere")
def test_an_interrupt_does_not_reach_the_server_while_it_reads_in():
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("0 True\n", "")


DEFERRED = """
import os, signal, sys, threading
from lpfcosim.execution import forkserver
number = int(sys.argv[1])
if number == signal.SIGTERM:
    signal.signal(number, signal.default_int_handler)
other = threading.Thread(target=threading.Event().wait, daemon=True)  # whom the system may tell
other.start()
try:
    with forkserver.interrupts_held():
        os.kill(os.getpid(), number)
        print("whole", flush=True)
except KeyboardInterrupt:
    print("told")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="signals are those of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_waits_until_a_process_has_started(number):
    command = [sys.executable, "-c", DEFERRED, str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30)
    assert (done.stdout, done.stderr) == ("whole\ntold\n", "")


IGNORED = """
import os, signal
from lpfcosim.execution import forkserver
signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a job in the background begins
signal.signal(signal.SIGTERM, signal.default_int_handler)
try:
    with forkserver.interrupts_held():
        os.kill(os.getpid(), signal.SIGINT)
    print("ignored", flush=True)
    with forkserver.interrupts_held():
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGTERM)
except KeyboardInterrupt:
    print("ended")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="signals are those of POSIX")
def test_an_interrupt_that_is_ignored_stays_so_and_hides_no_other():
    done = subprocess.run(
        [sys.executable, "-c", IGNORED], capture_output=True, text=True, check=True, timeout=30
    )
    assert (done.stdout, done.stderr) == ("ignored\nended\n", "")


def test_it_can_be_read_in_where_there_is_no_such_server(monkeypatch):
    """As on Windows, whose standard library lacks its context."""
    monkeypatch.delattr(multiprocessing.context, "ForkServerContext")
    monkeypatch.delattr(signal, "pthread_sigmask", raising=False)
    spec = importlib.util.find_spec("lpfcosim.execution.forkserver")
    fresh = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fresh)
    with fresh.interrupts_held():
        pass


SERVER_KILLED = """
import os, signal, sys, time
from multiprocessing import forkserver as standard
from pathlib import Path
from lpfcosim.errors import RunError
from lpfcosim.execution import forkserver, process_pool

def work(where):
    where.rest()
    (Path(sys.argv[1]) / str(os.getpid())).touch()
    time.sleep(60)

def kill(*_):
    if len([p for p in Path(sys.argv[1]).iterdir() if p.name.isdecimal()]) == 2:
        os.kill(standard._forkserver._forkserver_pid, signal.SIGKILL)

if __name__ == "__main__":
    forkserver.preload()
    place = Path(sys.argv[1])
    try:
        setting = process_pool.WorkerConfig(work, place, place / "logs")
        list(process_pool.results(setting, dict.fromkeys("abc", ()), 2, progress=kill))
    except RunError as error:
        print(error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="there is no such server elsewhere")
def test_a_server_that_is_killed_is_one_sentence_and_takes_its_workers_along(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "killed.py").write_text(SERVER_KILLED)
    command = [sys.executable, "killed.py", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=30, check=True)
    assert done.stderr == ""
    assert done.stdout == "the process that starts the others was killed (out of memory?)\n"
    (one, two) = (tmp_path / "out").iterdir()
    for worker in (one.name, two.name):
        state = Path(f"/proc/{worker}/stat")
        assert not state.exists() or ") Z " in state.read_text()  # nobody may have asked how it ended


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
def test_to_simulate_takes_no_library_that_takes_long_to_read_in(make_run, tmp_path, rate):
    task = tmp_path / "task"
    task.write_bytes(pickle.dumps((make_run(n_samples=12_000, sample_rate=rate), build.build())))
    done = subprocess.run([sys.executable, "-c", TASK, str(task)], capture_output=True, text=True, check=True)
    assert not {"pint", "scipy.linalg", "scipy.signal", "scipy.stats"} & set(done.stdout.split())
