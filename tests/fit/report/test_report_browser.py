"""The report in a real browser: nothing asked for, nothing refused, nothing cut off, all figures drawn."""

import time

import numpy as np
import pytest

from fit.forecasting.coverage import with_truth
from fit.pipeline import calibrate, calibrate_inertial
from fit.report.page import figure_specs, write_report
from fit.settings import settings
from fit.telemetry.reader import read_all
from tests.browser import Page, needs_browser
from tests.oracles import rotation_synthetic, synthetic
from tests.oracles.contract_file import write_contract_file

WIDTHS = (1280, 390)
EVIL = ("<script>alert(1)</script>", '"><img src=x onerror=alert(2)>')
READY = """[...document.querySelectorAll('.chart')].every(e => e.classList.contains('drawn'))
  && document.documentElement.scrollWidth <= innerWidth"""
#: What reaches beyond the window or out of its own box, other than what can be scrolled.
OVERFLOW = """[...document.querySelectorAll("main, main *:not(.uplot *)")].filter(e => {
  const box = e.getBoundingClientRect();
  if (!box.width || !e.checkVisibility() || e.closest(".scroll *, figure:has(> img) *")) return false;
  const scrolls = ["auto", "scroll"].includes(getComputedStyle(e).overflowX);
  return box.right > innerWidth + 1 || box.left < -1
    || (!scrolls && getComputedStyle(e).display !== "inline" && e.scrollWidth > e.clientWidth + 1);
}).map(e => `${e.tagName} ${e.className}: ${e.textContent.slice(0, 40)}`)"""
#: Width and height of every figure, and of the narrowest and widest canvas in it.
FIGURES = """[...document.querySelectorAll("figure")].map(figure => {
  const { width, height } = figure.getBoundingClientRect();
  const widths = [...figure.querySelectorAll("canvas")].map(e => e.getBoundingClientRect().width);
  return [width, height, Math.min(...widths), Math.max(...widths)];
})"""
#: What is read off the first plot: frequency, and each curve by its name.
READINGS = """[...document.querySelectorAll('.uplot')[0].querySelectorAll('.u-series')]
  .map(row => [row.querySelector('th').innerText.trim(), row.querySelector('td').innerText])"""
PLACE = """(box => [box.x + box.width / 2, box.y + box.height / 2])(
  document.querySelector('.u-over').getBoundingClientRect())"""


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


def calibration(folder):
    """A calibration with all there can be: two experiments, rotation."""
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
    return results, telemetries


def number(text):
    """A number as the page prints it, without its unit: 0.0123, or 1.23·10⁻¹⁴."""
    text = text.split()[0].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    mantissa, power, digits = text.rpartition("10-")
    return float(mantissa.rstrip("·") or 1) * 10.0 ** -int(digits) if power else float(digits)


@needs_browser
@pytest.mark.slow
def test_figures_are_drawn_nothing_is_cut_off_or_asked_for_and_the_pointer_reads_what_is_drawn(tmp_path):
    results, telemetries = calibration(tmp_path)
    drawn = {line.name: line for line in figure_specs(results, telemetries)[0].draw().panels[0].lines}
    with Page(write_report(tmp_path, results, telemetries)) as page:
        page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        for width in WIDTHS:
            page.resize(width, 40_000)  # charts are drawn when they come into sight
            deadline = time.monotonic() + 60
            while not page.evaluate(READY):
                assert time.monotonic() < deadline
                time.sleep(0.2)
            assert page.evaluate(OVERFLOW) == []
            figures = page.evaluate(FIGURES)
            assert len(figures) > 12
            for of_figure, height, narrowest, widest in figures:
                assert of_figure > 250 and height > 90
                assert 150 < narrowest <= widest <= of_figure + 1
        page.mouse("mouseMoved", *page.evaluate(PLACE))
        page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        readings = {name: number(text) for name, text in page.evaluate(READINGS)}
        frequency = readings.pop("frequency")
        assert readings.keys() == drawn.keys() and 1e-4 < frequency < 0.1
        for name, curve in drawn.items():
            assert readings[name] == pytest.approx(np.interp(frequency, curve.x, curve.y), rel=2e-3)
        assert page.console == []
        assert page.requests[1:] == []
