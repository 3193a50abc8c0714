"""Workflows from Python: a campaign in memory or by its path, typed results, one class of errors."""

import hashlib
import json
from dataclasses import FrozenInstanceError, replace

import h5py
import pytest

import fit
import lpfcosim
from tests.campaign_text import SHORT_PLAN


@pytest.fixture(scope="module")
def campaign(quickstart):
    return lpfcosim.load_campaign(quickstart)


def test_a_forecast_is_that_of_the_command(campaign, quickstart, lpfcosim_json):
    expected = lpfcosim.forecast(campaign)
    assert json.loads(expected.to_json()) == lpfcosim_json("forecast", quickstart)
    assert list(expected) == list(expected.joint.parameters)
    assert expected["lambda_2"].sigma == pytest.approx(3.47e-5, rel=0.01)
    frame = expected.to_dataframe()
    assert frame.loc["C_2", "ratio"] == frame.loc["C_2", "sigma"] / frame.loc["C_2", "flight_sigma"]
    assert repr(expected).startswith("parameter    unit        sigma    flight sigma  ratio\nlambda_2 ")
    assert "<td" in expected._repr_html_()
    with pytest.raises(fit.InputError, match=r"no parameter 'lambda_3', did you mean"):
        expected["lambda_3"]
    with pytest.raises(FrozenInstanceError):
        expected.joint = None


def test_margins_are_found_by_loop(campaign, quickstart):
    result = lpfcosim.margins(str(quickstart))
    assert json.loads(result.to_json())["loops"] == result.to_dataframe().reset_index().to_dict("records")
    assert list(result) == ["drag_free_x", "suspension_x"]
    assert result["suspension_x"].unity_gain == result.to_dataframe().loc["suspension_x", "unity_gain"]
    assert repr(lpfcosim.margins(campaign)) == repr(result)
    with pytest.raises(fit.InputError, match="no loop 'drag_free_y'"):
        result["drag_free_y"]


def test_a_check_has_margins_and_forecast(campaign):
    checked = lpfcosim.check(campaign)
    assert json.loads(checked.to_json())["schema"] == "lpf-check/1"
    assert checked.valid
    assert checked.forecast["C_2"].sigma == lpfcosim.forecast(campaign)["C_2"].sigma
    assert checked.to_dataframe().loc["A", "injections"] == 10
    text = repr(checked)
    assert text.startswith("valid: 8 runs along x, 48 h\n")
    assert "drag_free_x" in text
    assert "warning: the data do not determine lambda_1" in text


@pytest.mark.parametrize("argument", [3, None, "nowhere.toml", "no\0where"])
@pytest.mark.parametrize("name", ["check", "forecast", "margins", "montecarlo", "design", "identify", "run"])
def test_what_is_no_campaign_is_one_class_of_error(name, argument):
    with pytest.raises(fit.InputError):
        getattr(lpfcosim, name)(argument)


@pytest.mark.parametrize("jobs", [0, "2", 1.5])
@pytest.mark.parametrize("name", ["simulate", "run", "montecarlo", "design"])
def test_a_number_of_processes_is_one_or_more(name, jobs, campaign, tmp_path):
    size = (2,) if name == "montecarlo" else ()
    with pytest.raises(fit.InputError, match=r"^jobs: "):
        getattr(lpfcosim, name)(campaign, *size, tmp_path / "out.toml", jobs=jobs)


def test_telemetry_from_equations_is_checked_as_that_of_fmus(campaign, tmp_path):
    experiment = replace(campaign.experiments[0], duration=600.0, noise_duration=600.0, injections=())
    brief = replace(campaign, experiments=(experiment,))
    paths = lpfcosim.simulate(brief, tmp_path, fmus=False)
    recorded = [path.read_bytes() for path in paths]
    lines = {
        f"{hashlib.sha256(content).hexdigest()}  telemetry/{path.name}"
        for content, path in zip(recorded, paths, strict=True)
    }
    assert set((tmp_path / "telemetry.sha256").read_text().splitlines()) == lines
    middle = len(recorded[0]) // 2
    paths[0].write_bytes(recorded[0][:middle] + bytes(4000) + recorded[0][middle + 4000 :])
    assert lpfcosim.simulate(brief, tmp_path, fmus=False) == paths
    assert [path.read_bytes() for path in paths] == recorded
    with h5py.File(paths[1], "r+") as file:
        assert file.attrs["simulated_by"] == "model equations"
        file.attrs["equations_digest"] = "0" * 64  # as if the models had been edited since
    (tmp_path / "telemetry.sha256").unlink()
    with pytest.raises(fit.InputError, match="simulated with another version of the models"):
        lpfcosim.simulate(brief, tmp_path, fmus=False)
    with h5py.File(paths[1], "r+") as file:
        del file.attrs["simulated_by"]
    with pytest.raises(fit.InputError, match=r"simulated through the FMUs, now .*rerun=True"):
        lpfcosim.simulate(brief, tmp_path, fmus=False)
    assert lpfcosim.simulate(brief, tmp_path, fmus=False, rerun=True) == paths
    assert paths[1].read_bytes() == recorded[1]
    paths[1].rename(tmp_path / "telemetry" / "other.h5")
    with pytest.raises(fit.InputError, match=r"other\.h5: belongs to no run of this campaign"):
        lpfcosim.simulate(brief, tmp_path, fmus=False)


def test_a_simulated_folder_can_be_made_again(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(SHORT_PLAN, encoding="utf-8")
    lpfcosim.simulate(path, tmp_path / "out", fmus=False)
    digests = (tmp_path / "out" / "telemetry.sha256").read_bytes()
    lpfcosim.simulate(tmp_path / "out" / "campaign.toml", tmp_path / "again", fmus=False)
    assert (tmp_path / "again" / "telemetry.sha256").read_bytes() == digests
    changed = replace(lpfcosim.load_campaign(path), seed=8)
    lpfcosim.simulate(changed, tmp_path / "changed", fmus=False)
    assert not (tmp_path / "changed" / "campaign.toml").exists()


@pytest.mark.fmu
@pytest.mark.slow
def test_a_run_from_python_leaves_what_it_returns(quickstart, tmp_path):
    path = tmp_path / "short.toml"
    text = quickstart.read_text(encoding="utf-8").split("[[experiments]]")
    path.write_text("[[experiments]]".join(text[:2]), encoding="utf-8")
    finished = lpfcosim.run(path, tmp_path / "out", jobs=1)
    assert finished.failures == {}
    assert finished.results.experiments["A"]["lambda_2"].pull is not None
    assert finished.to_json() == (tmp_path / "out" / "results.json").read_text(encoding="utf-8")
    assert "lambda_2" in repr(finished)


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ("[fit.parameters.lambda_q]\nvary = false", "lambda_q: no parameter of this fit"),
        ('[fit]\nexclude = ["Q"]', "exclude"),
    ],
)
def test_run_refuses_an_unknown_name_before_anything_is_simulated(quickstart, tmp_path, table, sentence):
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "{quickstart.as_posix()}"\n{table}\n')
    with pytest.raises(fit.InputError, match=sentence):
        lpfcosim.run(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()
