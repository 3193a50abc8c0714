"""What is kept of long runs: in a file, whole, and gone in the end."""

import gc
import os
import sys
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from fit.pipeline import calibrate
from fit.signal import pages
from fit.weighing import Glitch, Shape, shapes
from tests.oracles import glitches, thirteen

LONG = pages.LONG + 1
in_files = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere all lies in memory")


def files():
    """How many there are of this process."""
    gc.collect()
    return sum("(deleted)" in line for line in Path("/proc/self/maps").read_text().splitlines())


def resident():
    """Bytes of this process that are in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@in_files
def test_memory_lets_go_of_what_is_put_down_and_has_it_again():
    found = pages.room((2**20, 4), LONG)
    assert found.flags.f_contiguous
    found[:] = np.arange(2**22).reshape(found.shape)
    before = resident()
    pages.put_down()
    assert before - resident() > 0.9 * found.nbytes
    assert np.array_equal(found, np.arange(2**22).reshape(found.shape))


@in_files
def test_a_file_is_there_as_long_as_part_of_it_is_asked_for():
    before = files()
    found = pages.copied(np.arange(6.0).reshape(2, 3), LONG)
    part = found[1:, ::2]
    del found
    assert files() == before + 1
    pages.put_down()
    assert part.tolist() == [[3.0, 5.0]]
    del part
    assert files() == before


def test_what_is_short_stays_where_it_is():
    x = np.zeros(5)
    assert pages.laid(x, pages.LONG) is x
    assert pages.room((2, 0), LONG).shape == (2, 0)


def test_without_a_folder_it_lies_in_memory(monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "none"))
    in_memory()


@in_files
def test_where_no_room_can_be_reserved_it_lies_in_memory(monkeypatch, tmp_path):
    # NFS before 4.2 refuses, as a full disk does; nobody writes byte after byte to reserve it
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(pages._LIBRARY, "fallocate", lambda *_: -1)
    in_memory()


@in_files
def test_room_beyond_what_a_file_may_have_is_refused():
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, limits[1]))
    try:
        in_memory(2**10)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def in_memory(size=3):
    found = pages.copied(np.eye(size), LONG)
    assert found.base is None
    assert np.array_equal(found, np.eye(size))


@in_files
def test_threads_put_down_what_others_write():
    rooms, done = [pages.room((2**16,), LONG) for _ in range(4)], []

    def write(k):
        for n in range(50):
            rooms[k][:] = k + n
            pages.put_down()
            done.append(bool(np.all(rooms[k] == k + n)))

    threads = [Thread(target=write, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(done) == 200 and all(done)


def estimates(runs):
    joint = calibrate(runs).joint
    return np.array([(e.value, e.sigma) for e in joint.parameters.values()])


def test_the_fit_is_the_same_in_files(monkeypatch, changed):
    runs = list(thirteen.campaign(seed=5, names=("A1", "B2", "D2", "C4")).values())
    struck_by = [glitches.Glitch(4000.0, 30.0, 1500.0, "one", 60.0, 2)]
    runs[0] = glitches.struck(thirteen.made("A1", "sysid", 5), struck_by)
    in_memory = estimates(runs)
    asked, room = [], pages.room
    changed(pages, "LONG", 2**12)
    monkeypatch.setattr(pages, "room", lambda *given: asked.append(given) or room(*given))
    moved = estimates(runs) - in_memory
    assert len(asked) > 100
    assert np.abs(moved / in_memory[:, 1:]).max() < 1e-4


@pytest.mark.parametrize("long", [7, 333])
def test_glitches_are_the_same_however_much_is_made_at_once(long, changed):
    kinds = [Shape("pushed", 30.0, 0.3), Shape("swinging", 45.0, 1.0), Shape("rising", 200.0)]
    found, time = [Glitch(shape, 100.3 * k) for k, shape in enumerate(kinds, 1)], np.arange(900) / 2
    ways = (shapes.columns, shapes.loose)
    at_once = [np.hstack(list(made(found, time, 2.0))) for made in ways]
    changed(pages, "LONG", long)
    for made, expected in zip(ways, at_once, strict=True):
        assert np.array_equal(np.hstack(list(made(found, time, 2.0))), expected)
