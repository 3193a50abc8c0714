"""Zoom and read-off in a real browser: what is told is what was drawn, and nothing else happens."""

import re
from importlib import resources

import numpy as np
import pytest

from fit.figures import COLOURS
from fit.figures.files import ASD, FREQUENCY, Axis, Curve, column, drawing, legend_above, plot
from tests.browser import Page, needs_browser

pytestmark = [needs_browser, pytest.mark.slow]
SCRIPT = resources.files("fit.report") / "templates" / "figure.js"
F = np.geomspace(1e-4, 1, 81)


def spectra():
    figure, (panel,) = column(2.2, FREQUENCY, ASD)
    drawn = [Curve("falling", F, 1e-15 / F, 0.5e-15 / F, 2e-15 / F), Curve("flat", F, np.full(81, 1e-13))]
    for curve, role in zip(drawn, ("blue", "orange"), strict=True):
        panel.draw(curve, role, label=curve.name)
    panel.ax.set_xlim(1e-4, 1.0)
    panel.ax.set_ylim(1e-16, 1e-10)
    panel.moving.append(panel.ax.axvspan(0.1, 1.0))
    legend_above(panel.ax, columns=2)
    return plot(figure, [panel])


def series():
    figure, panels = column(1.0, Axis("time", "h", "t [h]"), *2 * [Axis("o₁", "nm", "value [nm]")])
    t = np.linspace(0, 6, 61)
    drawn = [Curve("up", t, t - 3), Curve("down", t, 3 - t)]
    for panel, curve in zip(panels, drawn, strict=True):
        panel.draw(curve, "blue", label=curve.name)
        panel.ax.set_ylim(-4, 4)
    panels[-1].ax.set_xlim(0, 6)
    return plot(figure, panels)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    found = [
        drawing(folder, (name,), f"about {name}", "", draw) for name, draw in (("s", spectra), ("t", series))
    ]
    colours = "".join(f"--{role}: {colour};" for role, colour in COLOURS.items())
    page = folder / "page.html"
    page.write_text(
        f"<!DOCTYPE html><meta charset=utf-8><style>:root {{{colours}}} svg {{width: 600px}}</style>"
        + "".join(f"<figure>{d.svg}</figure>" for d in found)
        + f"<script>{SCRIPT.read_text(encoding='utf-8')}</script>",
        encoding="utf-8",
    )
    return page


@pytest.fixture
def page(path):
    with Page(path) as page:
        yield page
        assert page.console == []
        assert page.requests == [path.as_uri()]


def place(page, n, across, up):
    """A place in the window, from shares of the n-th axes."""
    box = f"document.querySelectorAll('.plane')[{n}].getBoundingClientRect()"
    x, y, width, height = page.evaluate(f"(b => [b.x, b.y, b.width, b.height])({box})")
    return x + across * width, y + (1 - up) * height


def read(page, n=0):
    """What is told of the n-th figure: name of the curve, and its two numbers."""
    text = page.evaluate(f"document.querySelectorAll('output')[{n}].innerText")
    name, numbers = text.splitlines()[0].split(": ")
    return name, *(number(word) for word in re.findall(r"[−\d.][\d.·⁰-⁹⁻¹²³]*(?= )", numbers))


def number(text):
    digits = text.replace("−", "-").translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    for i, c in enumerate(text):
        if c in "⁻⁰¹²³⁴⁵⁶⁷⁸⁹":  # a power of ten
            mantissa, _, ten = digits[:i].rpartition("·")
            assert ten == "10"
            return float(mantissa or 1) * 10.0 ** int(digits[i:])
    return float(digits)


def drag(page, n, start, end):
    page.mouse("mousePressed", *place(page, n, *start), button="left", buttons=1, clickCount=1)
    page.mouse("mouseMoved", *place(page, n, *end), button="left", buttons=1)
    page.mouse("mouseReleased", *place(page, n, *end), button="left", clickCount=1)


def ticks(page):
    return page.evaluate("[...document.querySelectorAll('.ticks text')].map(t => t.textContent)")


def paths(page):
    """Places of all curves [pt]."""
    told = page.evaluate("[...document.querySelectorAll('[data-curve] path')].map(p => p.getAttribute('d'))")
    return [np.array(re.findall(r"[ML] (\S+) (\S+)", d), dtype=float) for d in told]


def test_the_pointer_reads_what_was_drawn(page):
    page.mouse("mouseMoved", *place(page, 0, 0.25, 0.5))  # 1 mHz, 1e-13: nearest is the flat curve
    name, f, asd = read(page)
    assert name == "flat"
    assert (f, asd) == (pytest.approx(1e-3, rel=0.07), pytest.approx(1e-13, rel=2e-3))
    page.mouse("mouseMoved", *place(page, 0, 0.25, 0.65))
    name, f, asd = read(page)
    assert name == "falling"
    assert asd == pytest.approx(1e-15 / f, rel=2e-3)
    assert np.min(np.abs(F / f - 1)) < 2e-3
    page.mouse("mouseMoved", 1, 1)
    assert page.evaluate("document.querySelectorAll('.cross').length") == 0


def test_a_rectangle_zooms_and_a_double_click_goes_back(page):
    before = paths(page)
    drag(page, 0, (0.25, 0.2), (0.5, 0.8))  # 1 to 10 mHz
    assert "10⁻²" not in ticks(page)[0]
    page.mouse("mouseMoved", *place(page, 0, 0.5, 0.5))
    name, f, asd = read(page)
    assert (name, asd) == ("flat", pytest.approx(1e-13, rel=2e-3))
    assert f == pytest.approx(10**-2.5, rel=0.07)
    assert not np.allclose(paths(page)[0], before[0], atol=1)
    assert (
        page.evaluate("getComputedStyle(document.querySelector('[data-axes] [id*=tick_]')).display") == "none"
    )
    for count in (1, 2):
        at = place(page, 0, 0.5, 0.5)
        page.mouse("mousePressed", *at, button="left", buttons=1, clickCount=count)
        page.mouse("mouseReleased", *at, button="left", clickCount=count)
    for now, then in zip(paths(page), before, strict=True):
        np.testing.assert_allclose(now, then, atol=0.01)
    assert ticks(page) == []


def test_panels_share_their_time(page):
    drag(page, 2, (0.5, 0.5), (0.75, 0.5))  # of the lower one: 3 to 4.5 h
    up, down = paths(page)[-2:]
    assert np.allclose(up[:, 0], down[:, 0])
    assert ticks(page)[:1] != []
    page.mouse("mouseMoved", *place(page, 1, 0.99, 0.7))
    name, t, value = read(page, 1)
    assert name == "up"
    assert t == pytest.approx(4.5, abs=0.06)
    assert value == pytest.approx(t - 3, abs=0.01)


def test_the_wheel_scrolls_the_page_until_a_figure_is_chosen(page):
    at = place(page, 0, 0.5, 0.5)
    page.mouse("mouseWheel", *at, deltaX=0, deltaY=-100)
    assert ticks(page) == []
    drag(page, 0, (0.5, 0.5), (0.5, 0.5))  # a click
    page.mouse("mouseWheel", *at, deltaX=0, deltaY=-100)
    assert ticks(page) != []


def test_keys_do_the_same(page):
    page.evaluate("document.querySelector('.plane').focus()")
    page.key("ArrowRight")
    first = read(page)
    page.key("ArrowRight")
    second = read(page)
    assert (first[0], second[0]) == ("flat", "flat")
    assert second[1] / first[1] == pytest.approx(F[1] / F[0], rel=5e-3)
    page.key("ArrowUp")
    assert read(page)[0] == "falling"
    assert read(page)[1] == pytest.approx(second[1], rel=2e-3)
    page.key("+")
    assert ticks(page) != []
    page.key("Escape")
    assert ticks(page) == []


def test_a_finger_reads_and_two_zoom(page):
    def touch(kind, *shares):
        at = [dict(zip("xy", place(page, 0, *share), strict=True), id=i) for i, share in enumerate(shares)]
        page.send("Input.dispatchTouchEvent", type=kind, touchPoints=at)

    touch("touchStart", (0.25, 0.5))
    touch("touchEnd")
    assert read(page)[0] == "flat"
    assert ticks(page) == []
    touch("touchStart", (0.4, 0.5), (0.6, 0.5))
    touch("touchMove", (0.2, 0.5), (0.8, 0.5))
    touch("touchEnd")
    assert ticks(page) != []


def test_paper_shows_no_script(page):
    page.mouse("mouseMoved", *place(page, 0, 0.25, 0.5))
    page.send("Emulation.setEmulatedMedia", media="print")
    assert page.evaluate("getComputedStyle(document.querySelector('output')).display") == "none"
    assert page.evaluate("getComputedStyle(document.querySelector('.cross')).display") == "none"


def test_without_scripts_the_pictures_stand(path):
    with Page(path, scripts=False) as page:
        assert page.evaluate("document.querySelectorAll('output, .plane').length") == 0
        size = page.evaluate(
            "(b => [b.width, b.height])(document.querySelector('[data-curve] path').getBoundingClientRect())"
        )
        assert min(size) > 100
        assert page.console == []
