"""Files that are written at once."""

import pytest

from fit.errors import FitError
from fit.files import atomic


def test_a_name_that_is_not_utf_8_is_written_as_its_escape(tmp_path):
    atomic.write(tmp_path / "report.html", "a\udcffb.h5")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == r"a\udcffb.h5"


def test_a_file_that_cannot_be_written_stays_as_it_was(tmp_path, monkeypatch):
    path = tmp_path / "results.json"
    atomic.write(path, "before")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic.os, "fsync", fail)
    with pytest.raises(FitError, match=r"results\.json: cannot be written \(No space left"):
        atomic.write(path, "after")
    assert path.read_text() == "before"
    assert [file.name for file in tmp_path.iterdir()] == ["results.json"]
