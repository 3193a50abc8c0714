"""Workflows from Python: a campaign in memory or by its path, typed results, one class of errors."""

import hashlib
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import FrozenInstanceError, replace
from functools import partial

import h5py
import pytest

import fit
import lpfcosim
from lpfcosim.execution import runner
from tests.campaign_text import SHORT_PLAN


@pytest.fixture(scope="module")
def campaign(quickstart):
    return lpfcosim.load_campaign(quickstart)


@pytest.fixture(scope="module")
def checked(campaign):
    return lpfcosim.check(campaign)


@pytest.fixture
def in_process(monkeypatch):
    """Simulate in this process, which takes no time to start."""
    with ThreadPoolExecutor(1) as executor:
        options = partial(runner.RunOptions, executor=executor)
        monkeypatch.setattr(runner, "RunOptions", lambda jobs, rerun: options(jobs, rerun=rerun))
        yield


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """The file of a campaign of one short experiment."""
    path = tmp_path_factory.mktemp("short") / "short.toml"
    path.write_text(SHORT_PLAN, encoding="utf-8")
    return path


def test_a_check_has_runs_margins_and_the_forecast_of_the_command(checked, quickstart, lpfcosim_json):
    assert checked.valid
    assert json.loads(checked.forecast.to_json()) == lpfcosim_json("forecast", quickstart)
    assert checked.to_dataframe().loc["A", "injections"] == 10
    assert list(checked.margins) == ["drag_free_x", "suspension_x"]
    assert checked.document()["loops"] == checked.margins.to_dataframe().reset_index().to_dict("records")
    text = repr(checked)
    assert text.startswith("valid: 8 runs along x, 48 h\n")
    assert "warning: the data do not determine lambda_1" in text
    assert json.loads(checked.to_json())["schema"] == "lpf-check/1"


def test_a_result_is_a_table_indexed_by_name(checked):
    forecast = checked.forecast
    assert list(forecast) == list(forecast.joint.parameters)
    assert forecast["lambda_2"].sigma == pytest.approx(3.47e-5, rel=0.01)
    frame = forecast.to_dataframe()
    assert frame.loc["C_2", "ratio"] == frame.loc["C_2", "sigma"] / frame.loc["C_2", "flight_sigma"]
    assert repr(forecast).startswith("parameter    unit        sigma    flight sigma  ratio\nlambda_2 ")
    assert "<td" in forecast._repr_html_()
    with pytest.raises(fit.InputError, match=r"no parameter 'lambda_3', did you mean"):
        forecast["lambda_3"]
    with pytest.raises(FrozenInstanceError):
        forecast.joint = None


def test_margins_are_the_same_by_path_and_in_memory(checked, quickstart):
    assert repr(lpfcosim.margins(str(quickstart))) == repr(checked.margins)


@pytest.mark.parametrize("name", ["check", "forecast", "margins", "montecarlo", "design", "identify", "run"])
def test_what_is_no_campaign_or_no_number_of_processes_is_one_class_of_error(name, campaign, tmp_path):
    workflow = getattr(lpfcosim, name)
    for argument in (3, None, "nowhere.toml", "no\0where"):
        with pytest.raises(fit.InputError):
            workflow(argument)
    for jobs in (0, "2", 1.5) if name in ("run", "montecarlo", "design") else ():
        with pytest.raises(fit.InputError, match=r"^jobs: "):
            workflow(campaign, out=tmp_path / "out.toml", jobs=jobs)


@pytest.mark.usefixtures("in_process")
def test_telemetry_from_equations_is_checked_as_that_of_fmus(short, tmp_path):
    paths = lpfcosim.simulate(short, tmp_path, fmus=False)
    recorded = [path.read_bytes() for path in paths]
    lines = {
        f"{hashlib.sha256(content).hexdigest()}  telemetry/{path.name}"
        for content, path in zip(recorded, paths, strict=True)
    }
    assert set((tmp_path / "telemetry.sha256").read_text().splitlines()) == lines
    paths[0].write_bytes(recorded[0][:-4000] + bytes(4000))
    assert lpfcosim.simulate(short, tmp_path, fmus=False) == paths
    assert [path.read_bytes() for path in paths] == recorded
    with h5py.File(paths[1], "r+") as file:
        assert file.attrs["simulated_by"] == "model equations"
        file.attrs["equations_digest"] = "0" * 64  # as if the models had been edited since
    (tmp_path / "telemetry.sha256").unlink()
    with pytest.raises(fit.InputError, match="simulated with another version of the models"):
        lpfcosim.simulate(short, tmp_path, fmus=False)
    with h5py.File(paths[1], "r+") as file:
        del file.attrs["simulated_by"]
    with pytest.raises(fit.InputError, match=r"simulated through the FMUs, now .*rerun=True"):
        lpfcosim.simulate(short, tmp_path, fmus=False)
    assert lpfcosim.simulate(short, tmp_path, fmus=False, rerun=True) == paths
    assert paths[1].read_bytes() == recorded[1]


@pytest.mark.usefixtures("in_process")
def test_a_simulated_folder_can_be_made_again(short, tmp_path):
    lpfcosim.simulate(short, tmp_path / "out", fmus=False)
    digests = (tmp_path / "out" / "telemetry.sha256").read_bytes()
    lpfcosim.simulate(tmp_path / "out" / "campaign.toml", tmp_path / "again", fmus=False)
    assert (tmp_path / "again" / "telemetry.sha256").read_bytes() == digests
    changed = replace(lpfcosim.load_campaign(short), seed=8)
    lpfcosim.simulate(changed, tmp_path / "changed", fmus=False)
    assert not (tmp_path / "changed" / "campaign.toml").exists()
