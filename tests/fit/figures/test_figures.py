"""Figures as records: what they say is what the run has, and their tables hold what is drawn."""

from dataclasses import replace

import numpy as np
import pytest

from fit.figures import analysis, series
from fit.figures import runs as figures_runs
from fit.figures.charts import ASD, START, TIME, Chart, Curve, Panel, Points, limits
from fit.report.experiments import AnalysedExperiment, figure_specs
from tests.oracles.synthetic import World, of_run, pair, telemetry

TRUTH = of_run(World(), "A")


@pytest.fixture(scope="module")
def runs():
    return pair(World(), "A", seed=1, drive_1=1e-12)


@pytest.fixture(scope="module")
def charts(runs):
    """The figures of an experiment by what they show."""
    specs = figure_specs("e1", "A", AnalysedExperiment(*runs, TRUTH, []))
    return {drawing.name.rpartition("-")[2]: drawing.draw() for drawing in specs}


def test_a_column_stands_where_any_curve_has_it():
    x = np.arange(2.0)
    dots = Points(
        name="dots", label="", role="ink", x=x + 0.1, y=x, low=x, high=x, names="AB", offset=np.full(2, 0.1)
    )
    line = Curve(name="line", label="", role="ink", x=x, y=x)
    panel = Panel(START, ASD, (dots, line), (0, 1), (0, 1), 1.0)
    magnified = replace(panel, marks=(replace(dots, label="again"),))  # its curve is in the table already
    columns = Chart((panel, magnified)).columns
    assert [*columns] == ["curve", "start", ASD.head, "low", "high", "name"]
    assert [*columns["start"]] == ["1970-01-01T00:00:00", "1970-01-01T00:00:01"] * 2
    assert columns["name"] == ["A", "B", "", ""]
    assert np.isnan(columns["low"][2:]).all()
    untitled = replace(panel, y=TIME, title="below")
    assert {"value", "quantity", "unit", "panel"} <= Chart((panel, untitled)).columns.keys()


def curves(chart):
    return {line.name: line for panel in chart.panels for line in panel.lines}


def test_the_axes_show_every_value_with_a_little_room():
    line = Curve(name="", label="", role="ink", x=np.arange(1.0, 5), y=np.array([1.0, np.nan, 3.0, 100.0]))
    assert limits(TIME, [line], (1, 3)) == pytest.approx((0.9, 3.1))  # 5 % of what is seen
    assert limits(ASD, [line]) == pytest.approx((10**-0.1, 10**2.1))
    assert limits(TIME, [line], key="x") == pytest.approx((0.85, 4.15))
    banded = Curve(name="", label="", role="ink", x=line.x, y=line.y, low=line.y - 1, high=line.y + 1)
    assert limits(ASD, [banded])[0] == pytest.approx(1 / 101**0.05)  # a bound of 0 is nowhere
    assert limits(TIME, []) == (0.0, 1.0)


def test_terms_are_those_of_newton():
    # 10 Hz, one tone in each channel: amplitudes and phases by hand (Eq. (11))
    run = telemetry(World(), "A", "sysid", noisy=False)
    fs, n = 10.0, 20_000
    t = np.arange(n) / fs
    f = {"o_1": 5e-3, "o_12": 0.02, "f_x_1": 0.11, "f_x_2": 0.3}
    wave = {name: np.sin(2 * np.pi * f[name] * t) for name in f}
    run = type(run)(**{**vars(run), "fs": fs, "time": t, "channels": wave})
    terms = analysis.split(run, {**TRUTH, "delta_ifo": 2e-5})[0]
    inner = terms.time
    assert np.diff(inner) == pytest.approx(0.3)

    def tone(name, order=0, late=0.0):
        w = 2 * np.pi * f[name]
        attenuation = np.sinc(f[name] * 0.1) if name.startswith("f") else 1.0
        return attenuation * w**order * np.sin(w * (inner - late) + order * np.pi / 2)

    tau = [TRUTH[f"C_{j}"] / TRUTH[f"lambda_{j}"] for j in (1, 2)]
    expected = {
        "ddo_12": tone("o_12", 2),
        "lambda_2 f_x_2": -TRUTH["lambda_2"] * tone("f_x_2", late=tau[1]),
        "lambda_1 f_x_1": TRUTH["lambda_1"] * tone("f_x_1", late=tau[0]),
        "omega2_2 o_12": TRUTH["omega2_2"] * tone("o_12"),
        "domega2_12 o_1": (TRUTH["domega2_12"] - 2e-5 * TRUTH["omega2_2"]) * tone("o_1"),
        "delta_ifo ddo_1": -2e-5 * tone("o_1", 2),
    }
    assert terms.terms.keys() == expected.keys()
    for name, term in expected.items():
        np.testing.assert_allclose(terms.terms[name], term, atol=1e-5 * np.abs(term).max(), err_msg=name)
    np.testing.assert_allclose(terms.total, sum(expected.values()), atol=1e-5)


def test_the_residual_lies_on_the_noise_and_its_tones_stand_out(charts):
    spectra = curves(charts["spectra"])
    residual, signal = spectra["residual Delta g"], spectra["signal ddo_12"]
    flat = (residual.x > 2e-3) & (residual.x < 2e-2)
    assert np.median(residual.y[flat]) == pytest.approx(
        4e-15, rel=0.15, abs=0
    )  # the plateau of the synthetic world
    assert signal.y.max() > 300 * 4e-15
    assert residual.x.max() <= 0.5  # 1 Hz
    assert np.all(residual.low < residual.y)


def test_what_was_decimated_for_the_eye_is_flat_up_to_the_edge():
    # white read-out noise of 10 Hz: the second derivative of o_12 has (2 pi f)^2 times its ASD up to 1 Hz.
    # Of the ASD of a bin sigma is 0.5 / sqrt(70 ordinates) or less, 6 %; the median of ten is known to 3 %.
    run = telemetry(World(), "A", "sysid", noisy=False)
    n = 60_000
    rng = np.random.default_rng(4)
    zeros = {name: np.zeros(n) for name in ("o_1", "f_x_1", "f_x_2")}
    channels = {**zeros, "o_12": 1e-12 * rng.standard_normal(n)}
    run = type(run)(**{**vars(run), "fs": 10.0, "time": np.arange(n) / 10, "channels": channels})
    asd = analysis.analyse(run, {"lambda_2": 1.0})[0].terms["ddo_12"]
    level = asd.asd / (2 * np.pi * asd.f) ** 2 / (1e-12 * np.sqrt(2 / 10))
    for low, high in ((0.03, 0.1), (0.1, 0.4), (0.4, 0.99)):
        assert np.median(level[(asd.f > low) & (asd.f < high)]) == pytest.approx(1, abs=0.06)


def test_an_average_lets_no_high_frequency_through_at_an_edge():
    t = np.arange(0, 3600, 0.3)
    x = np.where((t > 1000) & (t < 1030), np.nan, np.sin(2 * np.pi * t))
    average = series.averaged(x, 20 / 0.3, 1)
    inside = average[(t > 100) & (t < 900)]
    assert np.nanmax(np.abs(average)) < 1.01 * np.abs(inside).max() < 1e-3
    assert np.isfinite(average).mean() > 0.97


def test_a_glitch_hides_neither_the_residual_nor_its_spectrum(runs):
    run = runs[0]
    hit = np.where((run.time >= 5000) & (run.time < 5030), 1e-10, 0.0)  # a force that o_12 does not follow
    disturbed = replace(run, channels={**run.channels, "f_x_2": run.channels["f_x_2"] + hit})
    (undisturbed,) = analysis.analyse(run, TRUTH)
    unmasked, masked = (analysis.analyse(disturbed, TRUTH, spans)[0] for spans in ((), [(4998.0, 5032.0)]))
    levels = [
        np.mean(x.asd.asd[(x.asd.f > 1e-3) & (x.asd.f < 1e-2)]) for x in (masked, unmasked, undisturbed)
    ]
    assert levels[0] == pytest.approx(levels[2], rel=0.2)
    assert levels[1] > 3 * levels[2]
    up, hidden, right = (
        np.ptp(figures_runs.residual(run, [(analysed, None)]).panels[1].up)
        for analysed in (masked, unmasked, undisturbed)
    )
    assert up == pytest.approx(right, rel=0.2)
    assert hidden > 5 * right


def test_the_signal_dwarfs_the_residual_which_magnified_is_the_noise(charts):
    signal_panel, residual_panel = charts["residual"].panels
    signal, small = signal_panel.lines
    assert (signal_panel.y.unit, residual_panel.y.unit) == ("pm s⁻²", "fm s⁻²")
    assert np.nanmax(np.abs(signal.y)) > 50 * np.nanmax(np.abs(small.y))
    by_name = curves(charts["residual"])
    noise, residual = (by_name[f"{name} averaged over 200 s"] for name in ("noise run", "residual"))
    assert np.nanstd(residual.y) == pytest.approx(np.nanstd(noise.y), rel=0.3)
    assert noise.x[-1] <= residual_panel.across[1]
    units = np.array(charts["residual"].columns["unit"])
    assert set(units[: signal_panel.lines[0].x.size]) == {"pm s⁻²"}
