"""What a notebook needs: names that cost nothing, the values of the command line, displays that are sound."""

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from uncertainties import ufloat_fromstr

import fit
import lpfcosim as simulator
from fit import pipeline, settings
from fit.deltag import write_delta_g
from fit.findings import Finding
from fit.results import Fit, Results
from fit.results.estimates import Estimate
from fit.results.provenance import Provenance
from tests import ROOT
from tests.fit.telemetry.mapped import Archive, listed, write
from tests.oracles.contract_file import write_contract_file
from tests.oracles.synthetic import World, pair
from tests.test_docs import Runner, blocks

DOCUMENT = ROOT / "docs" / "python.md"


@pytest.fixture(scope="module")
def campaign(quickstart):
    """Experiments C and D of the quick start."""
    whole = simulator.load_campaign(str(quickstart))
    return replace(whole, experiments=whole.experiments[-2:])


@pytest.fixture(scope="module")
def folder(campaign, tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulated")
    paths = simulator.simulate(campaign, str(folder), fmus=False)
    assert paths == [folder / "telemetry" / f"{run.name}.h5" for run in campaign.runs]
    return folder


@pytest.fixture(scope="module")
def runs(folder):
    return fit.load(str(folder / "telemetry"))


@pytest.fixture(scope="module")
def results(runs):
    return fit.calibrate(runs)


# Names ----------------------------------------------------------------------------------------------------


# Loading --------------------------------------------------------------------------------------------------


def test_load_takes_files_lists_and_folders_of_a_run(folder, runs):
    names = ["C-noise", "C", "D-noise", "D"]
    assert [run.run for run in runs] == names
    assert [run.run for run in fit.load(folder)] == names
    files = [str(folder / "telemetry" / f"{name}.h5") for name in reversed(names)]
    assert [run.run for run in fit.load(files)] == names
    assert [run.run for run in fit.load(files[0])] == ["D"]


@pytest.fixture
def archived(tmp_path, monkeypatch):
    """An archive and its map, flight.toml, in the present folder; returns the runs in it."""
    run, _ = pair(World(), "E", duration=240.0, drive_1=1e-13, experiment="E1")
    write(tmp_path / "A.csv", {"t": run.time.tolist(), **listed(run.channels)})
    Archive(tmp_path).convert()
    (tmp_path / "map.toml").rename(tmp_path / "flight.toml")
    monkeypatch.chdir(tmp_path)
    return [run]


def test_load_converts_what_a_map_describes(archived, tmp_path):
    loaded = fit.load("flight.toml")
    assert {run.path.parent for run in loaded} == {Path("flight/telemetry").absolute()}
    elsewhere = fit.load(tmp_path / "flight.toml", folder=tmp_path / "elsewhere")
    assert {run.path.parent for run in elsewhere} == {tmp_path / "elsewhere"}
    for one, other in zip(
        sorted(loaded, key=lambda r: r.run), sorted(archived, key=lambda r: r.run), strict=True
    ):
        np.testing.assert_array_equal(one.channels["o_12"], other.channels["o_12"])


# Results --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_values_are_those_of_the_command_line(lpfcosim, folder, tmp_path):
    files = [folder / "telemetry" / name for name in ("D-noise.h5", "D.h5")]
    status, _, err = lpfcosim("fit", *files, "--out", "by_command", "--quiet")
    assert status == 0, err
    runs = fit.load(files)
    results = fit.calibrate(runs)
    expected = json.loads((tmp_path / "by_command" / "results.json").read_text(encoding="utf-8"))
    results.save(str(tmp_path / "results.json"))
    found = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    for section in ("joint", "experiments", "cross_talk", "inertial"):
        assert found[section] == expected[section]
    assert found["joint"]["parameters"]["lambda_2"]["pull"] == results.joint["lambda_2"].pull
    page = fit.save_report(results, runs, tmp_path / "by_function")
    assert page == tmp_path / "by_function" / "report.html"
    names, theirs = ({p.name for p in (tmp_path / f"by_{how}").iterdir()} for how in ("function", "command"))
    assert names == {"results.json", "report.html"} == theirs - {".lock"}
    written = fit.load_results(tmp_path / "by_function" / "results.json")
    assert [(page.parent / p).resolve() for p in written.provenance.telemetry] == files


def test_settings_are_those_of_table_fit(runs, tmp_path):
    (tmp_path / "fit.toml").write_text('[fit]\nestimator = "gaussian"\nexclude = ["C"]\n', encoding="utf-8")
    expected = pipeline.calibrate(runs, settings.read(tmp_path / "fit.toml"))
    found = fit.calibrate(runs, estimator="gaussian", exclude=["C"])
    assert found.provenance.settings == expected.provenance.settings
    assert [e.value for e in found.joint.parameters.values()] == [
        e.value for e in expected.joint.parameters.values()
    ]


def test_a_fit_is_indexed_by_names(results):
    joint = results.joint
    assert joint["lambda_2"] is joint.parameters["lambda_2"]
    assert list(joint) == list(joint.parameters)
    assert "lambda_2" in joint
    assert "lambda_1" not in joint
    with pytest.raises(fit.InputError, match="lambda_1 is not determined by these data"):
        joint["lambda_1"]
    with pytest.raises(
        fit.InputError, match="lambda_3 is no parameter of this fit, expected one of lambda_2"
    ):
        joint["lambda_3"]
    sigma = np.array([joint[name].sigma for name in joint])
    np.testing.assert_allclose(joint.correlation * np.outer(sigma, sigma), joint.covariance_matrix, rtol=1e-9)


def test_estimates_and_covariance_as_data_frames(results):
    frame = results.to_dataframe()
    row = frame.loc["joint", "", "C_2", "s"]
    assert (row["value"], row["sigma"]) == (results.joint["C_2"].value, results.joint["C_2"].sigma)
    assert row["sound"] and row["constraint"] == "" and row["truth"] == results.joint["C_2"].truth
    expected = len(results.joint.parameters) + sum(len(f.parameters) for f in results.experiments.values())
    assert len(frame) == expected
    covariance = results.joint.covariance(as_frame=True)
    assert list(covariance.columns) == list(covariance.index) == list(results.joint)
    assert covariance.loc["C_2", "C_2"] == pytest.approx(results.joint["C_2"].sigma ** 2, rel=1e-6, abs=0)
    np.testing.assert_array_equal(results.joint.covariance(), covariance)


def test_the_table_of_latex_has_every_parameter_of_the_joint_fit(results):
    lines = results.to_latex().splitlines()
    assert (lines[0], lines[-1]) == (r"\begin{tabular}{lll}", r"\end{tabular}")
    rows = [line for line in lines if line.startswith("$")]
    assert len(rows) == len(results.joint.parameters)
    assert all(line.count("&") == 2 and line.endswith(r"\\") for line in rows)
    joint = replace(
        results.joint,
        parameters={
            "omega2_2_0": Estimate(-3.983e-7, 5.3e-9, "s-2", constraint="tied to omega2_1_0"),
            "C_2": Estimate(0.186, 5e-4, "s", constraint="prior 0.186 ± 0.0005"),
        },
        covariance_matrix=np.eye(2),
    )
    table = replace(results, joint=joint).to_latex()
    row = r"$\omega^2_{2,0}$ & $-3.983(53) \times 10^{-7}$ & $\mathrm{s}^{-2}$ & tied to omega2\_1\_0 \\"
    assert row in table and r"& prior 0.186 $\pm$ 0.0005 \\" in table


# Arrays with units ----------------------------------------------------------------------------------------


def test_to_xarray_is_what_xarray_reads_from_the_file(runs):
    for run in runs[-2:]:
        with xr.open_dataset(run.path, engine="h5netcdf") as expected:
            xr.testing.assert_identical(run.to_xarray(), expected.load())


def test_to_xarray_keeps_what_is_unknown(tmp_path):
    heat = {"temperature": (np.full(200, 21.5), "degC")}
    path = write_contract_file(tmp_path / "run.h5", channels=heat, spare_attribute="kept")
    found = fit.load(path)[0].to_xarray()
    assert (
        found["time"].attrs.pop("long_name") == "time since 2016-04-16T00:00:00Z"
    )  # which this file leaves out
    with xr.open_dataset(path, engine="h5netcdf") as expected:
        xr.testing.assert_identical(found, expected.load())


def test_delta_g_is_that_of_the_product_file(runs, results, tmp_path):
    run = runs[-1]
    found = fit.delta_g(run, results)
    notes = write_delta_g(run.path, tmp_path / "D-deltag.h5", results, {})
    with h5py.File(tmp_path / "D-deltag.h5") as file:
        names = set(file) - {"time"}
        assert set(found.channels) == names
        for name in names:
            np.testing.assert_array_equal(found.channels[name], file[name][:])
            assert found.units[name] == file[name].attrs["units"] == "m s-2"
            assert found.long_names[name] == file[name].attrs["long_name"]
        np.testing.assert_array_equal(found.time, file["time"][:])
        assert found.fs == file.attrs["fs"]
        assert found.attributes["notes"] == file.attrs["notes"] == "\n".join(notes)
    assert all(note in Page(found._repr_html_()).text for note in notes)
    with xr.open_dataset(tmp_path / "D-deltag.h5", engine="h5netcdf") as expected:
        xr.testing.assert_identical(found.to_xarray(), expected.load())
    with pytest.raises(fit.InputError, match="expected the joint fit"):
        fit.delta_g(run, replace(results, joint=None))


# Displays -------------------------------------------------------------------------------------------------


class Page(HTMLParser):
    """Cells of tables and all text; every element must be closed in order."""

    def __init__(self, text):
        super().__init__()
        self.open, self.rows, self.text = [], [], ""
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attributes):
        assert tag != "script"
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data
        if "td" in self.open or "th" in self.open:
            self.rows[-1][-1] += data


def value_and_sigma(text):
    """Value and uncertainty of a number such as ``-3.983(52)e-07``."""
    number = ufloat_fromstr(text)
    return number.nominal_value, number.std_dev


def test_results_are_shown_to_the_second_digit_of_sigma(results):
    rows = {row[0]: row for row in Page(results._repr_html_()).rows}
    lines = {line.split()[0]: line for line in repr(results).splitlines() if line}
    for name, estimate in results.joint.parameters.items():
        _, number, _, truth, pull = rows[name]
        value, sigma = value_and_sigma(number)
        assert value == pytest.approx(estimate.value, abs=estimate.sigma / 10)
        assert sigma == pytest.approx(estimate.sigma, rel=0.05)
        assert float(truth) == pytest.approx(estimate.truth, abs=estimate.sigma / 10)
        assert float(pull) == pytest.approx(estimate.pull, abs=0.01)
        assert lines[name].split() == " ".join(rows[name]).split()
    assert "warning: the data do not determine lambda_1" in repr(results)
    assert "the data do not determine lambda_1" in Page(results._repr_html_()).text


EVIL = "<script>alert(x)</script>&\"'"


def test_what_files_say_is_escaped(runs):
    estimate = Estimate(1.0, 0.1, EVIL, truth=1.05, pull=-0.5)
    one = Fit({EVIL: estimate}, np.array([[0.01]]), 1.0, 1, False, (Finding("code", EVIL),), 3)
    results = Results(one, {EVIL: one}, {}, {}, Provenance())
    run = replace(runs[0], run=EVIL, experiment=EVIL, channels={EVIL: np.zeros(3)})
    run = replace(run, units={EVIL: EVIL}, long_names={EVIL: EVIL})
    for shown in (one, results, run):
        page = Page(shown._repr_html_())
        assert EVIL in page.text
        assert repr(shown)
    assert "not converged" in repr(one)
    assert "3 samples masked" in repr(one)


def test_telemetry_shows_its_channels_without_reading_them(runs):
    run = replace(runs[0], channels=dict.fromkeys(runs[0].channels))
    rows = Page(run._repr_html_()).rows
    assert ["o_12", "m", run.long_names["o_12"]] in rows
    assert repr(run).startswith("<Telemetry C-noise: noise run of C, 6 h at 10 Hz from 2016-04-")


# Simulation -----------------------------------------------------------------------------------------------


@pytest.mark.fmu
def test_simulated_through_the_fmus_it_is_the_same(campaign, folder, tmp_path):
    brief = replace(
        campaign,
        experiments=[
            replace(e, duration=600.0, noise_duration=0.0, injections=()) for e in campaign.experiments
        ],
    )
    ours = simulator.simulate(brief, tmp_path / "fmus", jobs=1)
    theirs = simulator.simulate(brief, tmp_path / "reference", fmus=False)
    for one, other in zip(ours, theirs, strict=True):
        with h5py.File(one) as found, h5py.File(other) as expected:
            assert set(found) == set(expected)
            for name in set(found) - {"truth", "time"}:
                rms = np.sqrt(np.mean(expected[name][:] ** 2))
                assert np.abs(found[name][:] - expected[name][:]).max() <= 1e-9 * rms, name


@pytest.mark.slow
def test_the_page_runs_from_top_to_bottom_and_prints_what_it_says(lpfcosim, capfd, tmp_path):
    (tmp_path / "campaigns").symlink_to(ROOT / "campaigns", target_is_directory=True)
    runner = Runner(lpfcosim, capfd)
    for block in blocks(DOCUMENT):
        runner.run(block)
    assert (tmp_path / "example" / "report.html").is_file()
    assert (tmp_path / "spectra.pdf").is_file()
