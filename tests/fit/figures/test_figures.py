"""Figures as files: what is drawn is what is written, in every format, and always the same bytes."""

import csv
import html
import json
import re
import subprocess
import sys
from collections import defaultdict

import numpy as np
import pytest

from fit.estimate import masks
from fit.estimate.runs import Experiment, Run
from fit.figures import files as figure_files
from fit.figures import mission as figures_mission
from fit.figures import runs as figures_runs
from fit.report.experiments import drawings
from fit.results import Estimate, Fit
from fit.warnings import FitWarning, Span, masked
from tests.oracles.synthetic import World, of_run, pair, telemetry, without

TRUTH = of_run(World(), "A")
TEXTS = r"-?[\d.]+(?:e-?\d+)?"


@pytest.fixture(scope="module")
def runs():
    return pair(World(), "A", seed=1, drive_1=1e-12)


@pytest.fixture(scope="module")
def folder(runs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    drawings(folder, "e1", "A", tuple(runs), TRUTH, [])
    return folder


def table(path):
    """The rows of a CSV by the name of the curve, numbers as such, NaN where there are none."""
    found = defaultdict(list)
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    for name, *cells in rows:
        found[name].append([float(cell) if re.fullmatch(TEXTS, cell) else np.nan for cell in cells])
    return head, {name: np.array(values) for name, values in found.items()}


def curves(svg):
    """Read the curves of an SVG back, with nothing but its axes to tell what a place means."""
    found = {}
    for text, body in re.findall(r'data-axes="([^"]*)">(.*?)(?=data-axes=|</svg>)', svg, re.DOTALL):
        frame = json.loads(html.unescape(text))
        x0, y0, width, height = frame["box"]
        for name, path in re.findall(r'data-curve="([^"]*)">\s*<path d="([^"]*)"', body):
            places = np.array(re.findall(r"[ML] (\S+) (\S+)", path), dtype=float)
            shares = np.stack([(places[:, 0] - x0) / width, 1 - (places[:, 1] - y0) / height], axis=1)
            for i, key in enumerate("xy"):
                low, high = frame[key]["limits"]
                if frame[key]["log"]:
                    shares[:, i] = np.exp(np.log(low) + shares[:, i] * np.log(high / low))
                else:
                    shares[:, i] = low + shares[:, i] * (high - low)
            found[name] = shares, frame
    return found


@pytest.mark.parametrize("name", ["r-A-responses", "s-A-spectra", "b-A-breakdown", "t-A-residual"])
def test_what_is_drawn_is_what_is_written(folder, name):
    head, told = table(folder / f"e1{name}.csv")
    drawn = curves((folder / f"e1{name}.svg").read_text(encoding="utf-8"))
    assert told.keys() == drawn.keys()
    assert head[0] == "curve"
    assert re.fullmatch(r".* \[.*\]", head[1])
    for curve, (places, frame) in drawn.items():
        known = told[curve][:, :2]
        assert frame["y"]["unit"]
        known = known[np.isfinite(known).all(axis=1)]
        limits = np.array([frame["x"]["limits"], frame["y"]["limits"]]).T
        for i, key in enumerate("xy"):
            if frame[key]["log"]:
                known[:, i], places[:, i], limits[:, i] = map(
                    np.log, (known[:, i], places[:, i], limits[:, i])
                )
        inside = np.all((places > limits[0]) & (places < limits[1]), axis=1)  # beyond, curves are cut
        assert np.count_nonzero(inside) > 50
        size = limits[1] - limits[0]
        nearest = [np.min(np.max(np.abs(known - place) / size, axis=1)) for place in places[inside]]
        assert max(nearest) < 2e-3  # of the axes; a place is written to 0.01 pt


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
        "import sys; from pathlib import Path; from fit.report import experiments as r;"
        "from tests.oracles.synthetic import World, of_run, pair;"
        "runs = tuple(pair(World(), 'A', seed=1, drive_1=1e-12));"
        "r.drawings(Path(sys.argv[1]), 'e1', 'A', runs, of_run(World(), 'A'), [])"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True)
    for path in folder.iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name


def test_terms_are_those_of_newton():
    # 10 Hz, one tone in each channel: amplitudes and phases by hand (eq. deltagjointfit)
    run = telemetry(World(), "A", "sysid", noisy=False)
    fs, n = 10.0, 20_000
    t = np.arange(n) / fs
    f = {"o_1": 5e-3, "o_12": 0.02, "f_x_1": 0.11, "f_x_2": 0.3}
    wave = {name: np.sin(2 * np.pi * f[name] * t) for name in f}
    found = figures_runs.split(
        type(run)(**{**vars(run), "fs": fs, "time": t, "channels": wave}), {**TRUTH, "delta_ifo": 2e-5}
    )
    inner = t[10:-10]

    def tone(name, order=0, late=0.0):
        w = 2 * np.pi * f[name]
        hold = np.sinc(f[name] * 0.1) if name.startswith("f") else 1.0
        return hold * w**order * np.sin(w * (inner - late) + order * np.pi / 2)

    tau = [TRUTH[f"C_{j}"] / TRUTH[f"lambda_{j}"] for j in (1, 2)]
    expected = {
        "ddo_12": tone("o_12", 2),
        "lambda_2 f_x_2": -TRUTH["lambda_2"] * tone("f_x_2", late=tau[1]),
        "lambda_1 f_x_1": TRUTH["lambda_1"] * tone("f_x_1", late=tau[0]),
        "omega2_2 o_12": TRUTH["omega2_2"] * tone("o_12"),
        "domega2_12 o_1": (TRUTH["domega2_12"] - 2e-5 * TRUTH["omega2_2"]) * tone("o_1"),
        "delta_ifo ddo_1": -2e-5 * tone("o_1", 2),
    }
    assert found.terms.keys() == expected.keys()
    for name, term in expected.items():
        np.testing.assert_allclose(found.terms[name], term, atol=1e-5 * np.abs(term).max(), err_msg=name)
    np.testing.assert_allclose(found.delta_g, sum(expected.values()), atol=1e-5)
    np.testing.assert_allclose(found.signal, expected["ddo_12"], atol=1e-7)


def test_the_residual_lies_on_the_noise_and_its_tones_stand_out(folder):
    _, told = table(folder / "e1s-A-spectra.csv")
    f, residual = told["residual Delta g"].T[:2]
    signal = told["signal ddo_12"]
    flat = (f > 2e-3) & (f < 2e-2)
    assert np.median(residual[flat]) == pytest.approx(4e-15, rel=0.15)  # the plateau of the synthetic world
    assert signal[:, 1].max() > 300 * 4e-15
    assert f.max() <= 0.5  # 1 Hz


def test_gaps_and_glitches_are_marked(runs, folder, tmp_path):
    gone = without(runs[0], (4000, 4200), (9000, 9050))
    spans = (Span(gone.run, 100.0, 112.0), Span("another", 5.0, 6.0), Span(gone.run, 900.0, 907.0))
    told = masked([FitWarning("glitches", (), "masked", spans=spans)], gone.run)
    assert told == [(100.0, 112.0), (900.0, 907.0)]
    figure_files.write(tmp_path, "t", figures_runs.residual, gone, TRUTH, told)
    text = (tmp_path / "t.svg").read_text(encoding="utf-8")
    assert text.count("data-moves") == 4
    assert (folder / "e1t-A-residual.svg").read_text(encoding="utf-8").count("data-moves") == 0
    _, told = table(tmp_path / "t.csv")
    hours = told["averaged over 200 s"].T
    inside = (hours[0] > 4060 / 3600) & (hours[0] < 4140 / 3600)
    assert np.isnan(hours[1][inside]).all()


def test_a_warning_holds_where_it_masked(runs):
    spoilt = pair(World(), "A", seed=1, drive_1=1e-12)[0]
    kick = np.where((spoilt.time >= 8000) & (spoilt.time < 8010), 1e-12, 0.0)
    spoilt.channels["f_x_2"] = spoilt.channels["f_x_2"] + kick  # a force that was commanded and did not act
    _, warnings = masks.without_glitches(Experiment(Run(spoilt), Run(runs[1])))
    ((begin, end),) = masked(warnings, spoilt.run)
    assert 7980 < begin < end < 8050


def test_runs_without_noise_can_be_drawn(tmp_path):
    runs = tuple(pair(World(), "A", noisy=False))
    assert not np.any(runs[1].channels["o_12"])
    assert len(drawings(tmp_path, "e1", "A", runs, TRUTH, [])) == 4


def test_long_names_do_not_break_a_figure(tmp_path):
    names = ["lambda_2", "a parameter whose name somebody chose to be as long as this one is"]
    found = Fit({n: Estimate(1.0, 1.0, "1") for n in names}, np.eye(2), 1.0, 1, True, ())
    figure_files.write(tmp_path, "c", figures_mission.correlations, found)
    assert (tmp_path / "c.csv").read_text().splitlines()[1].endswith(",0")
