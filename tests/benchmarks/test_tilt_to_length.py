"""The benchmark of tilt-to-length coupling: what it makes of its log."""

import numpy as np

from fit.tilt_to_length import NAMES
from tests.benchmarks import tilt_to_length


def test_pulls_are_those_of_the_log(tmp_path, monkeypatch):
    rng = np.random.default_rng(1)
    pulls = rng.normal(size=(50, len(NAMES)))
    lines = [
        {"errors": dict(zip(NAMES, 1e-5 * p, strict=True)), "sigmas": dict.fromkeys(NAMES, 1e-5)}
        for p in pulls
    ]
    page = tmp_path / "page.md"
    page.write_text(f"head\n{tilt_to_length.BEGIN}\nold\n{tilt_to_length.END}\ntail\n")
    monkeypatch.setattr(tilt_to_length, "DOCS", page)
    tilt_to_length.write(lines)
    text = page.read_text().replace("\n", " ")
    assert "old" not in text
    assert f"rms pull is {np.sqrt(np.mean(pulls**2)):.3f}" in text
    assert "In 50 simulated calibrations the rms error is" in text
    row = (tmp_path / "ttl-pulls.csv").read_text().splitlines()[1].split(",")
    assert row[:4] == [NAMES[0], "50", f"{10 * np.sqrt(np.mean(pulls[:, 0] ** 2)):.2f}", "10.00"]
    assert row[4:] == [
        f"{x:.3f}" for x in (pulls[:, 0].mean(), pulls[:, 0].std(ddof=1), np.mean(np.abs(pulls[:, 0]) < 1))
    ]
