"""Figures in the page: what the script is given is what the figure holds, and what readers without it see."""

import base64
import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit.figures.charts import ASD, FREQUENCY, TIME, Axis, Chart, Curve, Matrix, Note, Panel, Points, Span
from fit.figures.leakage import leakage
from fit.report import charts, numbers
from fit.report.parts import Drawing
from fit.results.estimates import Estimate

F = np.geomspace(1e-4, 1, 200)
DATES = Axis("start of run", "UTC", "start", dates=True)
GAIN = Axis("λ₂", "1", "lambda_2 [1]")
EVIL = "</script><script>alert(1)</script>"


def line(x, y, **more):
    return Curve(**{"name": "a line", "label": "Δg_x", "role": "blue", "x": x, "y": y, **more})


def shown(chart):
    drawing = Drawing("name", f"what {EVIL} shows", "caption", lambda: chart)
    return charts.shown(drawing).element


def told(element):
    """Read back what the script reads."""
    (data,) = re.findall(r'<script type="application/json">(.*?)</script>', element, re.DOTALL)
    found = json.loads(data)
    found["arrays"] = [
        np.array([np.nan if v is None else v for v in a])
        if isinstance(a, list)
        else np.frombuffer(base64.b64decode(a), "<f4")
        for a in found["arrays"]
    ]
    return found


def test_the_script_gets_what_the_figure_holds():
    y = 1e-15 / F
    y[100] = np.nan
    spectra = line(F, y, low=0.5 * y, high=2 * y, dash="--")
    other = line(F, 3 * y, label="")
    panel = Panel(FREQUENCY, ASD, (spectra, other), (1e-4, 1.0), (1e-16, 1e-10), 2.2)
    found = told(shown(Chart((panel,), {})))
    (there,) = found["panels"]
    factor = there["y"]["factor"]
    first, second = there["marks"]
    assert first["x"] == second["x"]  # an array is told once
    assert len(found["arrays"]) == 5
    for key, values in (("x", F), ("y", y * factor), ("low", 0.5 * y * factor), ("high", 2 * y * factor)):
        np.testing.assert_allclose(found["arrays"][first[key]], values, rtol=1e-7)
    assert np.array(there["y"]["limits"]) / factor == pytest.approx([1e-16, 1e-10])
    assert (first["label"], first["dash"], second["label"]) == ("Δg<sub>x</sub>", "--", "")


def test_dates_and_small_differences_keep_their_digits():
    when = np.array([1460808000.0, 1460808001.0])
    dots = Points(
        name="p", label="alone", role="ink", x=when, y=np.array([1.07760001, 1.0776]),
        low=np.array([1.0, 1.0]), high=np.array([2.0, 2.0]), names=("A", EVIL),
    )  # fmt: skip
    found = told(shown(Chart((Panel(DATES, GAIN, (dots,), (1.46e9, 1.47e9), (1.0, 2.0), 2.0),), {})))
    (mark,) = found["panels"][0]["marks"]
    assert found["arrays"][mark["x"]].tolist() == when.tolist()
    assert found["arrays"][mark["y"]].tolist() == [1.07760001, 1.0776]
    assert mark["names"] == ["A", EVIL]


def test_nothing_ends_the_script_or_becomes_markup():
    panel = Panel(
        TIME, TIME, (line(F, F, name=EVIL, label=EVIL), Note(text=EVIL, x=0.1)), (0, 1), (0, 1), 1.0, EVIL
    )
    element = shown(Chart((panel, panel), {}, n_across=2))
    assert "<script>" not in element
    assert element.count("</script>") == 1
    assert told(element)["panels"][0]["title"] == EVIL
    assert (
        told(element)["panels"][0]["marks"][0]["label"]
        == "&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;"
    )


@given(size=st.floats(1e-25, 1e25), sign=st.sampled_from([-1, 1]))
def test_numbers_of_any_size_are_told_near_one(size, sign):
    panel = Panel(TIME, TIME, (line(F, sign * size * F),), (0, 1), (-size, size), 1.0)
    found = told(shown(Chart((panel,), {})))["panels"][0]["y"]
    assert 1e-3 < max(np.abs(found["limits"])) < 1e6
    assert np.array(found["limits"]) / found["factor"] == pytest.approx([-size, size])


def test_spans_and_notes_move_with_the_axes():
    marks = (
        Span(low=1e-13, high=2e-13, role="grid", opacity=0.5, along="y"),
        Span(low=0.1, high=1, role="blue", opacity=0.5, label="masked"),
        Note(text="here", x=0.5, y=1e-13),
        Note(text="below", x=0.5),
    )
    across, along, here, below = told(
        shown(Chart((Panel(FREQUENCY, ASD, marks, (1e-3, 1), (1e-14, 1e-12), 1.0),), {}))
    )["panels"][0]["marks"]
    assert (across["low"], across["high"]) == pytest.approx((10, 20))
    assert (along["low"], along["high"], along["label"]) == (0.1, 1, "masked")
    assert (here["y"], below["y"]) == (pytest.approx(10), None)


def cells(table):
    """Texts of a table by row."""
    rows = re.findall(r"<tr>(.*?)</tr>", table, re.DOTALL)
    return [[re.sub("<[^>]*>", "", c) for c in re.findall(r"<t[hd][^>]*>.*?</t[hd]>", row)] for row in rows]


def caption(table):
    (found,) = re.findall("<caption>(.*?)</caption>", table)
    return found


def test_the_table_of_a_spectrum_has_three_lines_a_decade_with_their_bands():
    y = 1e-15 / F
    spectra = line(F, y, low=0.9 * y, high=2 * y)
    panel = Panel(FREQUENCY, ASD, (spectra, line(F[:50], F[:50] * 1e-12)), (1e-4, 1.0), (1e-16, 1e-10), 2.2)
    table = numbers.tables(Chart((panel,), {}))
    assert caption(table) == "ASD  [10⁻¹⁵ m s⁻²/√Hz]"
    head, *rows = cells(table)
    assert head == ["frequency  [Hz]", "Δg x", "Δg x"]
    assert [row[0] for row in rows] == [f"{m * 10.0**e:.1g}" for e in range(-4, 0) for m in (1, 2, 5)] + ["1"]
    near = F[np.argmin(np.abs(np.log(F / 0.01)))]
    told, low, high = (f"{factor / near:.3g}" for factor in (1, 0.9, 2))
    assert rows[6][1] == f"{told} ({low} to {high})"
    assert rows[0][1] == "10000 (9000 to 20000)"
    assert rows[-1][2] == "–"  # the second curve ends before


def test_what_lies_below_a_panel_is_told_so():
    curves = (line(F, np.full(F.size, 3e-15)), line(F, 1e-17 * F, label="small"), line(F[:0], F[:0]))
    panel = Panel(FREQUENCY, ASD, curves, (1e-4, 1.0), (1e-16, 1e-10), 2.2)
    _, *rows = cells(numbers.tables(Chart((panel,), {})))
    assert {row[2] for row in rows} == {"&lt; 0.1"}
    assert {row[1] for row in rows} == {"3"}
    assert {row[3] for row in rows} == {"–"}


def test_time_series_share_a_table_of_least_and_largest():
    t = np.linspace(0, 10, 2001)
    other = Axis("o₁", "nm", "value")
    above = Panel(TIME, TIME, (line(t, -t), line(t, 0 * t, label="still")), (0, 10), (-10, 0), 1.0)
    below = Panel(TIME, other, (line(t, t), line(t, -t, is_repeated=True)), (0, 10), (0, 10), 1.0, "loop")
    over, head, *rows = cells(numbers.tables(Chart((above, below), {})))
    assert over == ["time since start of run  [h]", "time since start of run  [h]", "loop: o₁  [nm]"]
    assert head == ["Δg x", "still", "Δg x"]
    assert len(rows) == 10
    assert rows[0] == ["0 … 1", "−1 … 0", "0", "0 … 1"]


def dots(label, x, y, names=(), **more):
    x, y = np.array(x), np.array(y)
    return Points(
        name="p", label=label, role="ink", x=x, y=y, low=y - 0.0003, high=y + 0.0003, names=names, **more
    )


def test_points_share_a_table_that_has_every_one_once():
    places = [1460808000.0, 1460808000.0 + 86400]
    ends = np.array([1.46e9, 1.47e9])
    marks = (
        dots("alone", places, [1.0776, 1.0779], ("A1", "B1"), offset=np.array([0.1, -0.1])),
        dots("tone", places[:1], [1.0775], ("A1",)),
        Span(low=1.07758, high=1.07762, role="blue", opacity=0.2, along="y"),
        line(ends, np.full(2, 1.0776), label="joint"),
        line(ends, np.array([1.0, 2.0]), label="law"),
        line(ends, np.full(2, 0.5), label="limits", dash="--"),
        line(ends, np.full(2, -0.5), label="", dash="--"),
    )
    again = tuple(dots("", places, [1.0776, 1.0779], ("A1", "B1"), is_repeated=True) for _ in range(2))
    panels = (
        Panel(DATES, GAIN, again, (1.46e9, 1.47e9), (0.0, 9.0), 2.0),
        Panel(DATES, GAIN, marks, (1.46e9, 1.47e9), (1.0, 2.0), 2.0),
    )
    assert cells(numbers.tables(Chart(panels, {}))) == [
        ["start of run  [UTC]", "alone", "tone", "law"],
        ["A1, 2016-04-16", "1.0776 ± 0.0003", "1.0775 ± 0.0003", "1.08"],
        ["B1, 2016-04-17", "1.0779 ± 0.0003", "", "1.09"],
        ["joint", "1.07760 ± 0.00002"],
        ["limits", "0.5 and −0.5"],
    ]


def test_panels_beside_each_other_have_a_line_each():
    x = np.arange(-3.25, 3.3, 0.25)
    panels = []
    for name in ("A", "B"):
        band = line(x, 0 * x, name="95 % band", label="", low=0 * x - 0.2, high=0 * x + 0.2)
        own = line(x, 0.1 * x, name=name, label="")
        panels.append(Panel(GAIN, TIME, (band, own), (-3.5, 3.5), (-1, 1), 1.0, name))
    for kept in (panels, panels[:1]):
        table = numbers.tables(Chart(tuple(kept), {}, n_across=len(kept)))
        head, *rows = cells(table)
        assert head == ["", "−3", "−2", "−1", "0", "1", "2", "3"]
        assert [row[0] for row in rows] == ["A", "B"][: len(kept)]
        assert rows[0][1] == "−0.3 (±0.2)"
        assert caption(table).endswith("(±: 95 % band)")


def test_what_a_figure_magnifies_is_told_once():
    found = Estimate(-2.2e-5, 3e-7, "1")
    chart = leakage({1: found}, [("A", 1, found)], {1: found})
    table = numbers.tables(chart)
    assert table.count("<table") == 1
    assert cells(table) == [
        ["alignment epoch", "flight", "each experiment alone", "joint fit"],
        ["1", "−2.20 ± 0.03", "", "−2.20 ± 0.03"],
        ["A, 1", "", "−2.20 ± 0.03", ""],
        ["design, rms", "−6.3 … 6.3"],
        ["limits of the design", "17 and −17"],
    ]


def test_a_matrix_is_a_table_in_colours():
    matrix = Matrix(("lambda_2", "C_2", EVIL), np.array([[1.0, -0.951, 0], [-0.951, 1, 1], [0, 1, 1]]))
    element = shown(matrix)
    assert 'title="lambda_2, C_2: −0.9510">−95</td>' in element
    assert "var(--orange)" in element
    assert EVIL not in element
    assert element.count("<td style") == 3
