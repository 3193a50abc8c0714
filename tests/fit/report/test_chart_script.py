"""Charts in a real browser: what is read off is what was drawn, and zoom, keys, wheel, fingers, paper."""

import re
from importlib import resources

import numpy as np
import pytest

from fit.figures.charts import ASD, FREQUENCY, Axis, Chart, Curve, Panel, Points, Span
from fit.figures.colours import COLOURS
from fit.report import charts, page
from fit.report.section import FigureSpec
from tests.browser import Page, needs_browser

pytestmark = [needs_browser, pytest.mark.slow]
F = np.geomspace(1e-4, 1, 81)
HOURS = Axis("time", "h", "t [h]")
SHIFT = Axis("o₁", "nm", "value [nm]")


def curve(name, role, x, y, **style):
    return Curve(name=name, label=name, role=role, x=x, y=y, **style)


def spectra():
    falling = curve("falling", "blue", F, 1e-15 / F, low=0.5e-15 / F, high=2e-15 / F)
    flat = curve("flat", "orange", F[::2] * 1.01, np.full(41, 1e-13), dash="--")
    shade = Span(low=0.1, high=1.0, role="grid", opacity=0.5)
    return Chart((Panel(FREQUENCY, ASD, (shade, falling, flat), (1e-4, 1.0), (1e-16, 1e-10), 2.2),))


def series():
    t = np.linspace(0, 6, 61)
    gap = np.where((t > 1) & (t < 2), np.nan, t - 3)
    lower = (Span(low=1, high=2, role="violet", opacity=0.4, label="masked"), curve("down", "blue", t, 3 - t))
    panels = [Panel(HOURS, SHIFT, m, (0, 6), (-4, 4), 1.0) for m in ((curve("up", "blue", t, gap),), lower)]
    return Chart(tuple(panels))


def points():
    y = np.array([1.0776, 1.0777, 1.0779])
    dots = Points(
        name="alone", label="alone", role="ink", x=np.array([1.0, 3.0, 3.0]), y=y, low=y - 1e-4,
        high=y + 1e-4, names=("A", "B", "C<i>"),
    )  # fmt: skip
    return Chart((Panel(HOURS, Axis("λ₂", "1", ""), (dots,), (0, 6), (1.077, 1.078), 2.0),))


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    rendered = [
        charts.render(FigureSpec(f.__name__, f"about {f.__name__}", "", f)) for f in (spectra, series, points)
    ]
    colours = "".join(f"--{role}: {colour};" for role, colour in COLOURS.items())
    files = resources.files("fit.report")
    style = (files / "uplot" / "uPlot.min.css").read_text(encoding="utf-8")
    scripts = [(files / name).read_text(encoding="utf-8") for name in page.SCRIPTS]
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(
        f"<!DOCTYPE html><meta charset=utf-8><style>{style} :root {{{colours}}}"
        "figure {width: 600px}</style>"
        + "".join(f"<figure>{shown.element}</figure>" for shown in rendered)
        + "".join(f"<script>{script}</script>" for script in scripts),
        encoding="utf-8",
    )
    return path


@pytest.fixture
def shown(path):
    with Page(path) as page:
        page.resize(1280, 2400)  # all in sight
        page.evaluate("new Promise(done => setTimeout(done, 500))")
        yield page
        assert page.console == []
        assert page.requests == [path.as_uri()]


def place(page, n, across, up):
    """A place in the window, from shares of the n-th plot."""
    box = f"document.querySelectorAll('.u-over')[{n}].getBoundingClientRect()"
    x, y, width, height = page.evaluate(f"(b => [b.x, b.y, b.width, b.height])({box})")
    return x + across * width, y + (1 - up) * height


def pointer(page, n, across, up=0.5):
    """What is read off at a place: the legend's texts by name, numbers as such."""
    page.mouse("mouseMoved", *place(page, n, across, up))
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return read(page, n)


def read(page, n):
    rows = f"[...document.querySelectorAll('.uplot')[{n}].querySelectorAll('.u-series')]"
    texts = page.evaluate(
        rows + ".map(r => [r.querySelector('th').innerText.trim(), r.querySelector('td')?.innerText])"
    )
    return {name: text and number(text) for name, text in texts}


def number(text):
    text = re.sub(r"\(\d+\)", "", text.partition(" ")[0])
    words = text.replace("−", "-").translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    if "⁻" in text or "·10" in text:
        mantissa, _, power = words.rpartition("10") if "·" not in words else words.partition("·10")
        return float(mantissa or 1) * 10.0 ** int(power)
    return float(words)


def ink(page, n):
    """The pixels of the n-th plot."""
    return page.evaluate(f"document.querySelectorAll('.uplot canvas')[{n}].toDataURL()")


def test_the_pointer_reads_what_was_drawn(shown):
    readings = pointer(shown, 0, 0.25)
    assert readings["frequency"] == pytest.approx(1e-3, rel=0.06)
    assert readings["falling"] == pytest.approx(
        1e-15 / readings["frequency"], rel=0.07
    )  # the next of its own points
    assert readings["flat"] == pytest.approx(1e-13, rel=1e-3)
    readings = pointer(shown, 1, 0.25)  # 1.5 h, in the gap
    assert readings["time"] == pytest.approx(1.5, abs=0.06)
    assert read(shown, 2)["down"] == pytest.approx(1.5, abs=0.06)  # the pointer of one panel is that of all
