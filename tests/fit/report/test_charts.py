"""Figures in the page: what the script is given is what the figure holds."""

import base64
import json
import re

import numpy as np
import pytest

from fit.figures.charts import ASD, FREQUENCY, TIME, Axis, Chart, Curve, Note, Panel, Points
from fit.report import charts
from fit.report.section import FigureSpec

F = np.geomspace(1e-4, 1, 200)
DATES = Axis("start of run", "UTC", "start", dates=True)
GAIN = Axis("λ₂", "1", "lambda_2 [1]")
EVIL = "</script><script>alert(1)</script>"


def line(x, y, **style):
    return Curve(**{"name": "a line", "label": "Δg_x", "role": "blue", "x": x, "y": y, **style})


def shown(chart):
    drawing = FigureSpec("name", f"what {EVIL} shows", "caption", lambda: chart)
    return charts.render(drawing).element


def document(element):
    """Read back what the script reads."""
    (data,) = re.findall(r'<script type="application/json">(.*?)</script>', element, re.DOTALL)
    content = json.loads(data)
    content["arrays"] = [
        np.array([np.nan if v is None else v for v in a])
        if isinstance(a, list)
        else np.frombuffer(base64.b64decode(a), "<f4")
        for a in content["arrays"]
    ]
    return content


def test_the_script_gets_what_the_figure_holds():
    y = 1e-15 / F
    y[100] = np.nan
    spectra = line(F, y, low=0.5 * y, high=2 * y, dash="--")
    triple = line(F, 3 * y, label="")
    panel = Panel(FREQUENCY, ASD, (spectra, triple), (1e-4, 1.0), (1e-16, 1e-10), 2.2)
    content = document(shown(Chart((panel,))))
    (drawn_panel,) = content["panels"]
    factor = drawn_panel["y"]["factor"]
    banded, second = drawn_panel["marks"]
    assert banded["x"] == second["x"]  # an array is told once
    assert len(content["arrays"]) == 5
    for key, values in (("x", F), ("y", y * factor), ("low", 0.5 * y * factor), ("high", 2 * y * factor)):
        np.testing.assert_allclose(content["arrays"][banded[key]], values, rtol=1e-7)
    assert np.array(drawn_panel["y"]["limits"]) / factor == pytest.approx([1e-16, 1e-10], rel=1e-6, abs=0)
    assert (banded["label"], banded["dash"], second["label"]) == ("Δg<sub>x</sub>", "--", "")


def test_dates_and_small_differences_keep_their_digits():
    when = np.array([1460808000.0, 1460808001.0])
    dots = Points(
        name="p", label="alone", role="ink", x=when, y=np.array([1.07760001, 1.0776]),
        low=np.array([1.0, 1.0]), high=np.array([2.0, 2.0]), names=("A", EVIL),
    )  # fmt: skip
    content = document(shown(Chart((Panel(DATES, GAIN, (dots,), (1.46e9, 1.47e9), (1.0, 2.0), 2.0),))))
    (mark,) = content["panels"][0]["marks"]
    assert content["arrays"][mark["x"]].tolist() == when.tolist()
    assert content["arrays"][mark["y"]].tolist() == [1.07760001, 1.0776]
    assert mark["names"] == ["A", EVIL]


def test_nothing_ends_the_script_or_becomes_markup():
    panel = Panel(
        TIME, TIME, (line(F, F, name=EVIL, label=EVIL), Note(text=EVIL, x=0.1)), (0, 1), (0, 1), 1.0, EVIL
    )
    element = shown(Chart((panel,)))
    assert "<script>" not in element
    assert element.count("</script>") == 1
    (panel,) = document(element)["panels"]
    escaped = "&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;"
    assert (panel["title"], panel["marks"][0]["label"]) == (escaped, escaped)
