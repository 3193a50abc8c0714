"""The command ttl."""

import json
from importlib.util import find_spec

import numpy as np
import pytest

from fit.tilt_to_length import write_measurements
from tests import ROOT
from tests.fit.tilt_to_length.records import manoeuvre


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ttl")
    for name, run in zip(("m.h5", "n.h5"), manoeuvre(3), strict=True):
        write_measurements(run, folder / name)
    return folder


def test_coefficients_are_printed_and_written(lpfcosim_json, files, tmp_path):
    out = tmp_path / "out"
    document = lpfcosim_json("ttl", files / "m.h5", "--noise", files / "n.h5", "--out", out)
    assert document == json.loads((out / "results.json").read_text())
    assert document["schema"] == "lpf-results/1"
    assert len(document["ttl"]["names"]) == 24
    assert document["ttl"]["parameters"]["c_12_phi_rx"]["unit"] == "m rad-1"
    assert set(document["provenance"]["sha256"]) == {"m.h5", "n.h5"}
    spectra = {name: np.array(x) for name, x in document["provenance"]["subtraction_X2"].items()}
    tones = (spectra["f"] > 36e-3) & (spectra["f"] < 50e-3)
    assert np.all(spectra["after"][tones] < 0.1 * spectra["before"][tones])
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "All 24 tilt-to-length parameters lie within 4 σ of the true values" in report
    assert "m.h5, n.h5" in report and "Experiments" not in report
    assert {"least_squares", "bias", "instruments"} == {*document["provenance"]["estimators"]}


@pytest.mark.fmu
@pytest.mark.lisa
@pytest.mark.skipif(find_spec("lisainstrument") is None, reason="needs the extra lisa")
def test_a_campaign_is_simulated_measured_and_fitted(lpfcosim_json, tmp_path):
    document = lpfcosim_json("ttl", ROOT / "campaigns" / "lisa-ttl.toml", "--out", tmp_path / "out")
    assert document["ttl"]["sound"]
    assert {w["code"] for w in document["ttl"]["warnings"]} == set()
    estimates = document["ttl"]["parameters"].values()
    assert len(estimates) == 24
    assert np.sqrt(np.mean([(e["value"] - e["truth"]) ** 2 for e in estimates])) < 18e-6
    assert np.sqrt(np.mean([e["pull"] ** 2 for e in estimates])) < 1.4
