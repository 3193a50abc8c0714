"""The report in a real browser: nothing asked for, nothing refused, nothing cut off, all figures drawn."""

import time

import pytest

from fit.forecasting.coverage import with_truth
from fit.pipeline import calibrate, calibrate_inertial
from fit.report.page import write_report
from fit.settings import settings
from fit.telemetry.reader import read_all
from tests.browser import Page, needs_browser
from tests.oracles import rotation_synthetic, synthetic
from tests.oracles.contract_file import write_contract_file

pytestmark = [needs_browser, pytest.mark.slow]

WIDTHS = (1280, 390)
EVIL = ("<script>alert(1)</script>", '"><img src=x onerror=alert(2)>')
#: Every figure: its size, that of an image in it, and the widths of what was drawn or written in it.
WIDER = "document.documentElement.scrollWidth > innerWidth"
FIGURES = """[...document.querySelectorAll("figure")].map(figure => {
  const box = figure.getBoundingClientRect(), picture = figure.querySelector("img");
  const parts = [...figure.querySelectorAll("canvas, .matrix, .numbers")].filter(e => e.checkVisibility());
  return {
    what: figure.querySelector("figcaption").innerText, image: picture?.naturalWidth || 0,
    width: box.width, height: box.height, parts: parts.map(e => e.getBoundingClientRect().width),
  };
})"""
DRAWN = "[...document.querySelectorAll('.chart')].every(e => e.classList.contains('drawn'))"
#: What reaches beyond the window or out of its own box, other than what can be scrolled.
OVERFLOW = """[...document.querySelectorAll("main, main *:not(.uplot *)")].filter(e => {
  const box = e.getBoundingClientRect();
  if (!box.width || !e.checkVisibility() || e.closest(".scroll *, figure:has(> img) *")) return false;
  const scrolls = ["auto", "scroll"].includes(getComputedStyle(e).overflowX);
  return box.right > innerWidth + 1 || box.left < -1
    || (!scrolls && getComputedStyle(e).display !== "inline" && e.scrollWidth > e.clientWidth + 1);
}).map(e => `${e.tagName} ${e.className}: ${e.textContent.slice(0, 40)}`)"""
#: Text whose contrast with what is behind it is below WCAG AA.


def written(folder, telemetry, authority):
    """The run with its truth as a file, under the name of an experiment that means harm."""
    place = {name: getattr(telemetry, name) for name in ("fs", "kind", "alignment_epoch", "t0")}
    place |= {f"{kind}_max_{j}": getattr(telemetry, f"{kind}_max_{j}") for kind in "FN" for j in (1, 2)}
    truth = synthetic.of_run(synthetic.World(), authority)
    units = {name: "m" if "o_" in name else "m s-2" for name in telemetry.channels}
    return write_contract_file(
        folder / f"{authority}-{telemetry.kind}.h5",
        samples=telemetry.time.size,
        channels={name: (values, units[name]) for name, values in telemetry.channels.items()},
        truth=truth,
        run=f"{telemetry.experiment}-{telemetry.kind}",
        experiment=telemetry.experiment,
        **place,
    )


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """A report with all there can be: two experiments, rotation."""
    folder = tmp_path_factory.mktemp("report")
    files = [
        written(folder, run, authority)
        for authority, name in zip("AC", EVIL, strict=True)
        for run in synthetic.pair(synthetic.World(), authority, experiment=name)
    ]
    night = rotation_synthetic.run(duration=86400.0, inertial_period=3)[0]
    files.append(rotation_synthetic.write(folder, night))
    telemetries = read_all(files)
    results = with_truth(calibrate(telemetries, settings()), telemetries)
    if not results.inertial:
        results = calibrate_inertial([telemetries[-1]], results)
    return write_report(folder, results, telemetries)


#: Charts side by side that are not of one height.
UNEVEN = """(() => {
  const rows = {};
  for (const chart of document.querySelectorAll(".pair > figure > .chart")) {
    const { top, height } = chart.getBoundingClientRect();
    if (height) (rows[Math.round(top)] ??= []).push(height);
  }
  return Object.values(rows).filter(heights => Math.max(...heights) - Math.min(...heights) > 2);
})()"""


def in_order(page, figures):
    """No figure missing and nothing cut off, whatever the window is wide; what the browser has to say."""
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    for width in WIDTHS:
        page.resize(width, 40_000)  # charts are drawn when they come into sight
        deadline = time.monotonic() + 60
        while not page.evaluate(DRAWN):
            assert time.monotonic() < deadline
            time.sleep(0.2)
        while page.evaluate(WIDER):  # charts follow the window a moment later
            assert time.monotonic() < deadline
            time.sleep(0.2)
        assert page.evaluate(OVERFLOW) == []
        assert page.evaluate(UNEVEN) == []
        rendered = page.evaluate(FIGURES)
        assert len(rendered) == figures
        for figure in rendered:
            assert figure["width"] > 250, figure["what"]
            assert figure["height"] > 90, figure["what"]
            assert figure["image"] > 0 or figure["parts"], figure["what"]
            assert max(figure["parts"], default=0) <= figure["width"] + 1, figure["what"]
    assert page.console == []
    assert [address for address in page.requests[1:] if not address.startswith("data:image/svg")] == []


def test_everything_is_drawn_and_nothing_asked_for(report):
    figures = report.read_text(encoding="utf-8").count("<figure>")
    assert figures > 12
    with Page(report) as page:
        in_order(page, figures)
        page.evaluate("document.querySelectorAll('details').forEach(d => d.open = false)")
        page.evaluate("location.hash = '#e2'")
        assert page.evaluate("document.getElementById('e2').open")
