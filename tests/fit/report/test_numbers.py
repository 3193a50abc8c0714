"""The tables that stand in the place of figures where no script runs, cell by cell."""

import re

import numpy as np

from fit.figures.gain import GainPoint, gain_against_authority
from fit.report import numbers
from fit.results.estimates import Estimate

AUTHORITIES = {"A": 2.2e-9, "A1": 2.2e-9, "D": 5e-11}


def rows(chart):
    """Return the first column of every row, and the second."""
    cells = r"<tr><th scope=\"row\">(.*?)</th><td>(.*?)</td></tr>"
    return dict(re.findall(cells, str(numbers.tables(chart))))


def drawn(joint=None):
    points = [
        GainPoint(name, np.datetime64(f"2016-04-{i:02}"), F, Estimate(1.0771 + 1e-4 * i, 1.3e-4, "1"))
        for i, (name, F) in enumerate(AUTHORITIES.items(), 1)
    ]
    return gain_against_authority(points, joint)


def test_marks_that_stand_side_by_side_are_told_where_they_belong():
    chart = drawn()
    twins = next(mark for mark in chart.panels[0].lines if getattr(mark, "names", ()))
    assert np.unique(twins.x).size == 3
    found = rows(chart)
    assert list(found)[:3] == ["D, 50", "A, 2200", "A1, 2200"]
    assert found["D, 50"] == "1.07740 ± 0.00013"


def test_what_holds_throughout_is_told_once_with_its_sigma():
    assert rows(drawn(Estimate(1.0775, 1.3e-5, "1")))["joint fit, ±1 σ"] == "1.077500 ± 0.000013"
