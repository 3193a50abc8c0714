"""Figures as files for a journal: what is drawn is what is written, always the same bytes."""

import re

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


def test_files_are_for_a_journal(charts, tmp_path):
    plotting.write(tmp_path, "spectra", plotting.draw, charts["e1s-A-spectra"])
    data = (tmp_path / "spectra.pdf").read_bytes()
    assert b"/FontFile2" in data
    assert b"/Type3" not in data
    assert b"CreationDate" not in data
    (width,) = re.findall(rb"/MediaBox \[ ?0 0 ([\d.]+) ", data)
    assert float(width) == pytest.approx(72 * 3.375, abs=0.1)  # one column
    assert {p.suffix for p in tmp_path.iterdir()} == {".csv", ".pdf", ".svg"}
