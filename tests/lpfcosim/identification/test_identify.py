"""The command ``identify``: from telemetry to parameters of the FMUs, and what it refuses."""

import json
import shutil
from datetime import datetime, timedelta

import h5py
import pytest

from tests import campaign_text, third_party

pytestmark = pytest.mark.fmu

CAMPAIGN = campaign_text.campaign(
    'duration = "100 min"\nnoise_duration = "100 min"\ndc = "5e-12 m s^-2"',
    ("guidance_o_12", "1.5 mHz", "10 nm", 4, "300 s"),
    ("guidance_o_12", "13 mHz", "5 nm", 12, "3100 s"),
    ("guidance_o_1", "6 mHz", "5 nm", 20, "1000 s"),
    name="short",
    seed=7,
    tables="[fit]\ninclude_short = true\nglitches = false\n",
).replace('"one"', '"A"')
SOUGHT = """
[identify]
lambda_2 = {}
C_2 = {}
Plant.omega2_1_0 = { start = -5e-7, bounds = [-1e-6, 0] }
Plant.omega2_2_0 = { start = -5e-7, bounds = [-1e-6, 0] }
OpticalMetrology.delta_ifo = { shared = "experiment" }
"""


@pytest.fixture
def campaign(tmp_path):
    (tmp_path / "short.toml").write_text(CAMPAIGN)
    return tmp_path / "short.toml"


@pytest.fixture
def done(lpfcosim, campaign, tmp_path_factory):
    """The folder of a campaign that was run, simulated once a session."""
    kept = tmp_path_factory.getbasetemp() / "identify-short"
    if not kept.exists():
        lpfcosim("run", campaign, "--quiet", "--out", kept, status=0)
    shutil.copytree(kept, campaign.with_suffix(""))
    return campaign


@pytest.fixture
def identify(lpfcosim_json, done):
    """Identify what a table lists from the campaign that was run; return the joint fit, and its warnings."""

    def run(table, *options, status=0):
        done.write_text(f"{CAMPAIGN}\n{table}\n")
        joint = lpfcosim_json("identify", done, *options, status=status)["joint"]
        return joint, {w["code"]: w for w in joint["warnings"]}

    return run


def test_parameters_of_the_fmus_are_those_that_the_fit_finds(lpfcosim, done):
    done.write_text(CAMPAIGN + SOUGHT)
    _, out, err = lpfcosim("identify", done, "--json", status=0)
    said = list(dict.fromkeys(line.split(":")[0] for line in err.splitlines()))
    assert said[-3:] == ["reading", "simulations", "report"]
    result = json.loads(out)
    folder = done.with_suffix("")
    assert result == json.loads((folder / "identified.json").read_text())
    assert result["schema"] == "lpf-results/1"
    assert result["joint"]["names"] == ["lambda_2", "C_2", "omega2_1_0", "omega2_2_0", "delta_ifo_A"]
    fitted = json.loads((folder / "results.json").read_text())["experiments"]["A"]["parameters"]
    for name, theirs in (("lambda_2", "lambda_2"), ("C_2", "C_2"), ("delta_ifo_A", "delta_ifo")):
        mine = result["joint"]["parameters"][name]
        assert abs(mine["value"] - fitted[theirs]["value"]) < 0.05 * mine["sigma"]
        assert abs(mine["pull"]) < 4
    assert result["provenance"]["identified"]["omega2_2_0"] == {"model": "Plant", "variable": "omega2_2_0"}


@pytest.mark.slow
def test_gain_of_the_controller_and_of_the_actuation_are_one_number(identify):
    """Nor does it separate them how a run settles whose constant force they hold."""
    joint, warnings = identify("[identify]\nlambda_2 = {}\nC_2 = {}\nSuspensionControl.f_u = {}", status=1)
    assert not {"lambda_2", "SuspensionControl.f_u"} & set(joint["names"])
    assert {"lambda_2", "SuspensionControl.f_u"} <= set(warnings["indeterminable"]["combination"])


@pytest.mark.slow
def test_a_run_may_begin_in_the_midst_of_a_tone(identify, done, tmp_path):
    """What state the controller was in then is not known, and not needed."""
    paths, cut = [], 9000
    for path in sorted((done.with_suffix("") / "telemetry").glob("*.h5")):
        paths.append(tmp_path / path.name)
        shutil.copy(path, paths[-1])
        if path.stem != "A":
            continue
        with h5py.File(paths[-1], "r+") as file:
            for name in [name for name in file if isinstance(file[name], h5py.Dataset)]:
                kept, said = file[name][cut:], dict(file[name].attrs)
                del file[name]
                file.create_dataset(name, data=kept - kept[0] if name == "time" else kept).attrs.update(said)
            start = datetime.fromisoformat(file.attrs["t0"]) + timedelta(seconds=cut / 10)
            file.attrs["t0"] = start.isoformat().replace("+00:00", "Z")
    table = "[identify]\nlambda_2 = {}\nC_2 = {}\nomega2_2_0 = {}\ndelta_ifo = {}"
    mine, _ = identify(table, *paths, "--out", tmp_path / "cut")
    theirs = json.loads((tmp_path / "cut" / "results.json").read_text())["joint"]
    assert mine["chi2"] / mine["dof"] == pytest.approx(theirs["chi2"] / theirs["dof"], abs=0.005)
    shift = mine["parameters"]["lambda_2"]["value"] - theirs["parameters"]["lambda_2"]["value"]
    assert abs(shift) < 0.2 * theirs["parameters"]["lambda_2"]["sigma"]


@pytest.mark.parametrize(
    ("sought", "sentence"),
    [
        ("Plant.omega2_2 = {}", 'has no real parameter "omega2_2" that can be set'),
        ("lambda_2 = {}\nActuation.lambda_2 = {}", "identify: Actuation.lambda_2 is listed twice"),
        ("lambda_2 = { width = 1e-300 }", "identify.lambda_2.width: 1e-300 is too small"),
    ],
)
def test_what_cannot_be_sought_is_refused(lpfcosim, done, sought, sentence):
    done.write_text(f"{CAMPAIGN}\n[identify]\n{sought}\n")
    assert sentence in lpfcosim("identify", done, status=2)[2].splitlines()[-1]


def test_a_start_that_cannot_be_simulated_is_refused(lpfcosim, done):
    done.write_text(
        f"{CAMPAIGN}\n[identify]\nlambda_2 = {{}}\nSuspensionControl.f_p = {{ start = -0.006 }}\n"
    )
    err = lpfcosim("identify", done, status=2)[2]
    assert f"{done}: identify: start: run 'A' diverges: o_12 " in err.splitlines()[-1]


@pytest.mark.slow
def test_a_search_from_far_off_steps_back_from_what_cannot_be_and_ends_at_the_same(identify):
    near, _ = identify("[identify]\nlambda_2 = {}\nC_2 = {}")
    far, warnings = identify("[identify]\nlambda_2 = { start = 3 }\nC_2 = {}")
    expected = "the Plant FMU reports 'error' at 0.0 s (a delay is negative); simulated with lambda_2 = "
    assert expected in warnings["step_halved"]["message"]
    for name, estimate in near["parameters"].items():
        assert abs(far["parameters"][name]["value"] - estimate["value"]) < 0.01 * estimate["sigma"]


@pytest.mark.slow
def test_what_is_clipped_is_masked(lpfcosim, campaign):
    loud = campaign_text.sine("guidance_o_12", "40 mHz", "300 nm", 60, "3100 s")
    campaign.write_text(CAMPAIGN.replace("2200 pN", "50 pN") + loud)
    lpfcosim("run", campaign, "--quiet", status=0)
    _, out, err = lpfcosim("identify", campaign, "--json", status=0)
    assert "at the limit of its authority: f_x_2 in" in err
    result = json.loads(out)
    fitted = json.loads((campaign.with_suffix("") / "results.json").read_text())["joint"]["parameters"]
    for name, mine in result["joint"]["parameters"].items():
        assert abs(mine["value"] - fitted[name]["value"]) < 0.05 * mine["sigma"]
        assert mine["sigma"] == pytest.approx(fitted[name]["sigma"], rel=0.02)
        assert abs(mine["pull"]) < 4


def test_telemetry_of_another_campaign_is_refused_before_anything_is_fitted(lpfcosim, done, tmp_path):
    paths = done.with_suffix("") / "telemetry"
    done.write_text(CAMPAIGN.replace('"A"\nauthority', '"B"\nauthority'))
    for more in ((paths, "--out", tmp_path / "other"), ()):
        status, out, err = lpfcosim("identify", done, *more)
        assert (status, out) == (2, "")
        assert "fit:" not in err
        assert 'A-noise.h5: attribute experiment: "A", expected one of which' in err.splitlines()[-1]
        assert not (tmp_path / "other" / "results.json").exists()


def test_fmus_are_approved_before_anything_is_read_or_written(lpfcosim, campaign, tmp_path):
    third_party.built(tmp_path)
    campaign.write_text(CAMPAIGN + third_party.TABLE)
    err = lpfcosim("identify", campaign, "none.h5", "--out", "new", status=2)[2]
    assert "native code that lpfcosim did not build" in err
    assert "none.h5" not in err
    assert not (tmp_path / "new").exists()


def test_constraints_are_those_of_the_fit(identify, lpfcosim, done):
    table = "[fit.parameters.Plant]\nomega2_1_0 = { vary = false, value = -3.99e-7 }\n"
    done.write_text(f"{CAMPAIGN}\n{SOUGHT}\n{table}")
    status, out, err = lpfcosim("identify", done, "--fix", "C_2=0.186", "--json")
    assert (status, out) == (2, "")
    assert "fit.parameters.Plant.omega2_1_0: no parameter of this fit" in err  # its name is that of the fit
    joint, warnings = identify(SOUGHT, "--fix", "C_2=0.186", "--prior", "omega2_1_0=-4e-7,1e-9")
    assert joint["parameters"]["C_2"]["value"] == 0.186
    assert joint["parameters"]["C_2"]["constraint"] == "fixed"
    assert joint["parameters"]["omega2_1_0"]["sigma"] <= 1.001e-9
    assert warnings["constrained"]["parameters"] == ["C_2", "omega2_1_0"]


@pytest.mark.slow
def test_an_fmu_that_crashes_in_a_trial_is_named(lpfcosim, done, tmp_path):
    third_party.built(tmp_path, "CRASHES")
    done.write_text(CAMPAIGN + third_party.TABLE)
    before = (done.with_suffix("") / "results.json").read_bytes()
    err = lpfcosim("identify", done, "--trust", status=1)[2]
    assert "its process was ended by SIGSEGV at 5.0 s, in the SuspensionControl FMU" in err.splitlines()[-1]
    assert (done.with_suffix("") / "results.json").read_bytes() == before
    assert not (done.with_suffix("") / "identified.json").exists()
