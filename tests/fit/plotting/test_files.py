"""Figures as files for a journal: what is drawn is what is written, always the same bytes."""

import re
import subprocess
import sys

import numpy as np
import pytest

from fit import plotting
from fit.figures import gain
from fit.report.experiments import AnalysedExperiment, figure_specs
from fit.results.estimates import Estimate
from tests.oracles.synthetic import World, of_run, pair

TRUTH = of_run(World(), "A")


@pytest.fixture(scope="module")
def charts():
    runs = tuple(pair(World(), "A", seed=1, drive_1=1e-12))
    return {
        drawing.name: drawing.draw()
        for drawing in figure_specs("e1", "A", AnalysedExperiment(*runs, TRUTH, []))
    }


@pytest.fixture(scope="module")
def folder(charts, tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    for name, chart in charts.items():
        plotting.write(folder, name, plotting.draw, chart)
    return folder


def test_matplotlib_draws_every_curve_where_it_is(charts):
    for chart in charts.values():
        figure = plotting.draw(chart).figure
        for ax, panel in zip(figure.axes, chart.panels, strict=True):
            assert (ax.get_xlim(), ax.get_ylim()) == (pytest.approx(panel.across), pytest.approx(panel.up))
            assert panel.y.unit in ax.get_ylabel()
            drawn = [line.get_xydata() for line in ax.lines]
            for line, points in zip(panel.lines, drawn, strict=True):
                np.testing.assert_array_equal(points, np.stack([line.x, line.y], axis=1))


def test_dates_error_bars_and_grids():
    when = np.array(["2016-04-16T12", "2016-07-01T00"], dtype="datetime64[s]")
    estimate = Estimate(1.0776, 1e-4, "1")
    points = {n: (t, estimate) for n, t in zip("AB", when, strict=True)}
    (ax,) = plotting.draw(gain.gain_evolution(points, Estimate(1.0775, 1e-5, "1"))).figure.axes
    bars = [segment for c in ax.collections for segment in getattr(c, "get_segments", list)()]
    assert [bar[:, 0].tolist() for bar in bars] == [[16907.5] * 2, [16983.0] * 2]  # days since 1970
    assert bars[0][:, 1] == pytest.approx([1.0775, 1.0777])
    assert "joint fit, ±1 σ" in [text.get_text() for text in ax.get_legend().get_texts()]


def test_files_are_for_a_journal(folder):
    for path in folder.glob("*.pdf"):
        data = path.read_bytes()
        assert b"/FontFile2" in data
        assert b"/Type3" not in data
        assert b"CreationDate" not in data
        (width,) = re.findall(rb"/MediaBox \[ ?0 0 ([\d.]+) ", data)
        assert float(width) == pytest.approx(72 * 3.375, abs=0.1)  # one column
    assert {p.suffix for p in folder.iterdir()} == {".csv", ".pdf", ".svg"}


@pytest.mark.slow
def test_bytes_are_the_same_in_another_process(folder, tmp_path):
    code = (
        "import sys; from pathlib import Path; from fit import plotting\n"
        "from fit.report import experiments as r;"
        "from tests.oracles.synthetic import World, of_run, pair;"
        "runs = tuple(pair(World(), 'A', seed=1, drive_1=1e-12));"
        "[plotting.write(Path(sys.argv[1]), d.name, plotting.draw, d.draw())"
        " for d in r.figure_specs('e1', 'A', r.AnalysedExperiment(*runs, of_run(World(), 'A'), []))]"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True)
    for path in folder.iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name
