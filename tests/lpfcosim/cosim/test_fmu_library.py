"""Libraries that one run leaves to the next."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from lpfcosim.cosim import FmuLibraryCache, co_simulation, read_interfaces
from lpfcosim.modelica import build
from tests.lpfcosim.cosim import in_memory

pytestmark = pytest.mark.fmu

LOOP = 5  # FMUs along x


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """Count the folders of unpacked FMUs."""
    place = tmp_path / "unpacked"
    place.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(place))
    return lambda: len(os.listdir(place))  # noqa: PTH208


@pytest.fixture
def shelf():
    with FmuLibraryCache() as result:
        yield result


def simulate(run, fmus, shelf):
    return list(co_simulation.blocks(run, read_interfaces(run, fmus), libraries=shelf))


def test_a_run_is_the_same_whoever_had_the_libraries_before(fmus, make_run, folders, shelf):
    first, second = (make_run(n_samples=2500, seed=seed) for seed in (1, 2))
    simulate(first, fmus, shelf)
    assert folders() == LOOP
    again = simulate(second, fmus, shelf)
    assert folders() == LOOP
    for name, expected in in_memory.simulate(second, fmus).items():
        assert np.array_equal(np.concatenate([block[name] for block in again]), expected), name


def test_an_archive_that_was_built_anew_is_loaded_anew(make_run, folders, shelf, tmp_path):
    fmus = {model: Path(shutil.copy(path, tmp_path)) for model, path in build.build().items()}
    run = make_run(n_samples=10)
    simulate(run, fmus, shelf)
    os.utime(fmus["Plant"], ns=(1, 1))
    simulate(run, fmus, shelf)
    assert folders() == LOOP + 1
