"""What becomes of a task that fails in a way that nobody foresaw."""

import errno
from pathlib import Path

import pytest

from lpfcosim.errors import RunError
from lpfcosim.execution import process_pool
from lpfcosim.messages import grouped

CAUSES = {
    "value": ValueError("cannot reshape array of size 3 into shape (2,)"),
    "key": KeyError("o_12"),
    "disk": OSError(errno.ENOSPC, "No space left on device", "one.h5"),
    "bare": OSError("Unable to synchronously create file"),
}
INTERNAL = "internal error of lpfcosim, please report it with the traceback"


def work(cause, where):
    where.set_idle()
    raise CAUSES[cause]


@pytest.mark.parametrize(
    ("cause", "said"),
    [
        ("value", INTERNAL),
        ("key", INTERNAL),
        ("disk", "one.h5: No space left on device"),
        ("bare", INTERNAL),
    ],
)
def test_an_unexpected_exception_is_one_sentence_and_a_traceback_in_the_log(tmp_path, cause, said):
    setting = process_pool.WorkerConfig(work, tmp_path, tmp_path / "logs")
    ((name, error),) = process_pool.results(setting, {"A": (cause,)}, 1)
    assert (name, type(error)) == ("A", RunError)
    assert str(error) == f"run 'A' failed: {said}; see logs/A.log"
    log = Path(tmp_path / "logs" / "A.log").read_text()
    assert "Traceback" in log
    assert str(CAUSES[cause]) in log


def test_one_unexpected_exception_of_many_runs_is_one_sentence():
    causes = [(name, f"run '{name}' failed: {INTERNAL}; see logs/{name}.log") for name in "ABC"]
    assert grouped(causes) == [f"runs A, B, C: failed: {INTERNAL}; see logs/RUN.log"]
