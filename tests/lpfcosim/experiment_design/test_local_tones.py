"""The design of tones of one LISA spacecraft: against its forecast, a known case, and what is refused."""

import numpy as np
import pytest

from fit.lisa import expected_lisa_fit, tone_information
from fit.parameters import LISA
from fit.settings import settings
from lpfcosim.campaign import loading
from lpfcosim.linear import response
from lpfcosim.planned_experiments import planned_lisa_experiments
from tests import ROOT

CAMPAIGN = ROOT / "campaigns" / "lisa.toml"
STIFFNESS = ("omega2_x_1", "omega2_x_2")


def campaign(tmp_path, injections, fit="", sequences=""):
    """Return the path of a campaign of 20,400 s with injections."""
    path = tmp_path / "mine.toml"
    path.write_text(
        f'extends = "{CAMPAIGN}"\nname = "mine"\n[[experiments]]\nname = "A"\nauthority = "A"\n'
        f'duration = "20400 s"\nnoise_duration = "6 h"\nsequences = [{sequences}]\n'
        f"injections = [\n{injections}]\n{fit}"
    )
    return path


def sine(into, millihertz, cycles, amplitude="1 um"):
    return (
        f'{{ into = "{into}", shape = "sine", frequency = "{millihertz} mHz", amplitude = "{amplitude}", '
        f'cycles = {cycles}, start = "200 s" }},\n'
    )


@pytest.fixture
def two_tones(tmp_path):
    """Return the path of a campaign of two tones of 1 um, all but two stiffnesses known."""
    kinds = ("omega2_xy", "omega2_y", "lambda_y", "C_y", "grs_gain_y", "x_per_y")
    known = "".join(f"{name}_{j} = {{ vary = false }}\n" for name in kinds for j in (1, 2))
    tones = sine("guidance_o_1", 2, 40) + sine("guidance_o_2", 2.5, 50)
    return campaign(tmp_path, tones, f"[fit.parameters]\n{known}")


def test_two_tones_become_better_than_published(lpfcosim_json, tmp_path, two_tones):
    out = tmp_path / "d.toml"
    document = lpfcosim_json("design", two_tones, "--out", out)
    assert document["schema"] == "lpf-design/1"
    assert tuple(document["parameters"]) == STIFFNESS
    plan = loading.load(out)
    after = expected_lisa_fit(planned_lisa_experiments(plan), settings(plan.fit, "fit"))
    for name, share in zip(STIFFNESS, (0.00489, 0.00454), strict=True):  # cjss2026-0037
        row = document["parameters"][name]
        assert after[name].sigma == pytest.approx(row["sigma_after"], rel=1e-6)
        assert row["sigma_bound"] < row["sigma_after"] < 0.2 * share * abs(after[name].value)
    assert 0.8 < document["efficiency"] <= 1
    (experiment,) = plan.experiments
    assert [i.amplitude for i in experiment.injections] == [1e-6, 1e-6]
    assert [i.end for i in experiment.injections] == pytest.approx([20200.0, 20200.0])
    for limit in document["limits"]["A"].values():
        assert limit["reached"] <= limit["limit"]


def test_the_information_of_a_tone_is_that_of_its_forecast(tmp_path):
    # a long tone without transients to speak of; sigmas of the others fixed
    names = ("omega2_x_1",)
    every = [f"{k}_{j}" for k in ("omega2_x", "omega2_xy", "omega2_y", "lambda_y") for j in (1, 2)]
    every += [f"{k}_{j}" for k in ("C_y", "grs_gain_y", "x_per_y") for j in (1, 2)]
    known = "".join(f"{name} = {{ vary = false }}\n" for name in every if name not in names)
    path = campaign(tmp_path, sine("guidance_o_1", 2, 40), f"[fit.parameters]\n{known}")
    plan = loading.load(path)
    (planned,), (run,) = planned_lisa_experiments(plan), [r for r in plan.runs if r.kind == "sysid"]
    system = response.recorded_system(run)
    f = np.array([2e-3])
    transfer = system.select(["guidance_o_1"], system.outputs).frequency_response(f)[:, :, 0]
    motions = dict(zip(system.outputs, 1e-6 * transfer.T, strict=True))
    information = 20000.0 * tone_information(planned, every, f, motions)[0]
    places = [every.index(name) for name in names]
    prior = np.diag([LISA[name].sigma ** -2.0 for name in names])
    expected = expected_lisa_fit([planned], settings(plan.fit, "fit"))
    sigmas = np.diag(np.linalg.inv(information[np.ix_(places, places)] + prior)) ** 0.5
    assert expected["omega2_x_1"].sigma == pytest.approx(sigmas[0], rel=0.05)


def test_parameters_that_the_campaign_does_not_determine_do_not_count(lpfcosim_json, tmp_path):
    out = tmp_path / "d.toml"
    path = campaign(tmp_path, sine("guidance_o_1", 2, 40))
    document = lpfcosim_json("design", path, "--out", out)
    assert "omega2_x_1" in document["parameters"] and "lambda_y_1" not in document["parameters"]
    assert 0 < document["objective"]["bound"] < document["objective"]["value"] <= 1


def test_other_injections_remain(lpfcosim, tmp_path):
    path = campaign(
        tmp_path,
        sine("guidance_phi", 41, 50, "30 nrad") + sine("guidance_o_1", 2, 40) + sine("guidance_y_1", 3, 60),
    )
    out = tmp_path / "d.toml"
    lpfcosim("design", path, "--out", out, status=0)
    (before,), (after,) = (loading.load(p).experiments for p in (path, out))
    assert after.injections[0] == before.injections[0]
    assert [i.into for i in after.injections] == [i.into for i in before.injections]


@pytest.mark.parametrize(
    ("injections", "options", "message"),
    [
        (sine("guidance_phi", 41, 50, "30 nrad"), (), "no sine moves a test mass, expected one"),
        (sine("guidance_o_1", 2, 40), ("--figure", "f.svg"), "--figure: not available"),
    ],
)
def test_what_cannot_be_designed_is_refused(lpfcosim, tmp_path, injections, options, message):
    out = tmp_path / "d.toml"
    printed = lpfcosim("design", campaign(tmp_path, injections), "--out", out, *options, status=2)[2]
    assert message in printed
    assert not out.exists()
