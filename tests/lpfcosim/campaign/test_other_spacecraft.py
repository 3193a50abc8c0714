"""Campaign files of a spacecraft other than LISA Pathfinder: its keys are those that its model declares."""

import pytest

from lpfcosim import check, design, forecast, identify, montecarlo, run
from lpfcosim.campaign import loading
from lpfcosim.cli.new import json_schema
from lpfcosim.errors import InputError, UnavailableError
from lpfcosim.execution import telemetry_file
from lpfcosim.models import SpacecraftModel, model_of, one_axis, register, spacecraft_model
from tests import ROOT

TEXT = """
schema = "lpf-campaign/2"
name = "probe"
seed = 1
spacecraft = "probe"

[truth]
m_sc = "500 kg"
omega2_1_0 = "-5e-7 s^-2"
lambda_1 = 1.1

[control.DragFreeControl]
f_u = "90 mHz"

[noise]
readout = "2 pm Hz^-0.5"
thruster = "0.1 uN Hz^-0.5"

[authority]
A = { F_max_1 = "0 N", F_max_2 = "2200 pN", N_max_1 = "10.4 pN m", N_max_2 = "10.4 pN m" }

[[experiments]]
name = "A"
authority = "A"
duration = "2 h"
noise_duration = "2 h"
noise = { readout = "3 pm Hz^-0.5" }
injections = [
  { into = "guidance_o_1", shape = "sine", frequency = "1 mHz", amplitude="1 nm", cycles = 2, start = "0 h"},
  { into = "f_x_1_jitter", shape = "half_cosine", amplitude = "1 pm s^-2", start = "60 s", end = "90 s" },
]
"""


PROBE = SpacecraftModel(
    key="probe",
    name="of a probe",
    models=one_axis.MODEL.models,
    targets=("guidance_o_1", "guidance_o_12", "F_x_2", "f_x_1_jitter"),
    read_outs=("o_1", "o_12"),
    commands=("f_x_2",),
    noise={"readout": (("n_1", "n_12"), 0.0), "thruster": (("F_noise_x_sc",), 0.0)},
    channels=("f_applied_1", "f_control_2"),
)


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """Return the campaign of a text."""
    monkeypatch.setattr(spacecraft_model, "MODELS", dict(spacecraft_model.MODELS))
    register(PROBE)
    path = tmp_path / "c.toml"

    def load(text):
        path.write_text(text, encoding="utf-8")
        return loading.load(path)

    return load


def test_keys_reach_the_models(campaign):
    noise, sysid = campaign(TEXT).runs
    assert model_of(sysid) is PROBE
    parameters = PROBE.parameters(sysid)
    plant, actuation = parameters["Plant"], parameters["Actuation"]
    assert (plant["m_sc"], plant["omega2_1_0"]) == (500.0, -5e-7)
    assert (actuation["lambda_1"], actuation["F_max_2"]) == (1.1, 2.2e-9)
    assert parameters["DragFreeControl"] == {"h": 0.1, "m_sc": 500.0, "f_u": 0.09}
    assert sysid.noise == {"readout": 3e-12, "thruster": 1e-7}
    assert noise.noise == sysid.noise
    assert [i.amplitude for i in sysid.injections] == [1e-9, 1e-12]
    truth = telemetry_file.truth(sysid)
    assert truth.keys() == PROBE.truth_keys.keys()
    assert (truth["m_sc"], truth["omega2_2_0"]) == (500.0, -4.19e-7)


def test_fit_without_its_equation_of_motion_is_not_available(campaign):
    plan = campaign(TEXT)
    for workflow in (forecast, design, montecarlo, run, identify):
        with pytest.raises(UnavailableError, match="not available for runs of a probe"):
            workflow(plan)
    outcome = check(plan)
    assert outcome.forecast is None
    assert [margin.loop for margin in outcome.margins.loops] == ["drag_free_x", "suspension_x"]
    assert any("a forecast is not available" in warning for warning in outcome.warnings)


def test_lisa_pathfinder_takes_what_its_models_declare(campaign):
    text = (ROOT / "tests" / "two_experiments.toml").read_text(encoding="utf-8")
    plan = campaign(text.replace("[truth]", '[truth]\nT_sc = "2 s"'))
    assert plan.model.parameters(plan.runs[0])["Plant"]["T_sc"] == 2.0
    properties = json_schema()["properties"]
    assert properties["truth"]["properties"]["T_sc"]["type"] == "string"
    assert properties["noise"]["properties"]["readout"]["type"] == "string"


def test_a_spacecraft_has_authorities_of_its_own(campaign):
    """No line of LISA's: any parameter of its models of the name of a limit is one."""
    text = (ROOT / "campaigns" / "lisa.toml").read_text(encoding="utf-8")
    plan = campaign(text.replace("[authority.A]", '[authority.A]\nN_max_eta = "5 pN m"', 1))
    parameters = plan.model.parameters(plan.runs[0])["LISAActuation"]
    assert (parameters["F_max_yz"], parameters["N_max_eta"]) == pytest.approx((5e-9, 5e-12), rel=1e-6, abs=0)


def test_a_constant_acceleration_that_nothing_holds_is_refused(campaign):
    text = (ROOT / "campaigns" / "lisa.toml").read_text(encoding="utf-8")
    with pytest.raises(InputError, match=r"experiments\[0\].dc: nothing holds it in runs of LISA"):
        campaign(text.replace('duration = "6 h"', 'duration = "6 h"\ndc = "1e-12 m s^-2"', 1))
