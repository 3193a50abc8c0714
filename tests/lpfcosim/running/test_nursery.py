"""Workers come from somewhere, whatever becomes of the server that reads in libraries for them."""

import importlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from lpfcosim.running import nursery

SCRIPT = "from lpfcosim.running import nursery as n; n.prepare(); print(n.context().get_start_method())"


@pytest.mark.skipif(sys.platform != "linux", reason="there is no such server elsewhere")
@pytest.mark.parametrize(("folder", "method"), [("", "forkserver"), ("long" * 30, "spawn")])
def test_a_folder_with_a_long_path_for_temporary_files_is_no_hindrance(tmp_path, folder, method):
    temporary = tmp_path / folder if folder else Path(tempfile.gettempdir())
    temporary.mkdir(exist_ok=True)
    env = {**os.environ, "TMPDIR": str(temporary)}
    made = subprocess.run([sys.executable, "-c", SCRIPT], env=env, capture_output=True, text=True, check=True)
    assert made.stdout.strip() == method


@pytest.mark.parametrize("name", nursery.LIBRARIES)
def test_what_workers_need_is_there(name):
    importlib.import_module(name)  # the server says nothing of what it does not find
