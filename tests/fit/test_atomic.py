"""Files that are written at once."""

from fit.files import atomic


def test_a_name_that_is_not_utf_8_is_written_as_its_escape(tmp_path):
    atomic.write(tmp_path / "report.html", "a\udcffb.h5")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == r"a\udcffb.h5"
