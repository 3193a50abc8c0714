"""What cannot be simulated as it is meant is refused by every command alike, before anything is simulated."""

import json
import re
import zipfile
from dataclasses import replace

import fmpy
import pytest

import lpfcosim as package
from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from lpfcosim.execution import validation
from lpfcosim.modelica import build
from tests import ROOT, campaign_text
from tests.lpfcosim.cli.refusal import refusal, sentence

DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Mine" guid="{1}">
<CoSimulation modelIdentifier="Mine" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="m"><BaseUnit m="1"/></Unit><Unit name="nm"><BaseUnit m="1" factor="1e-9"/></Unit>
<Unit name="m/s2"><BaseUnit m="1" s="-2"/></Unit></UnitDefinitions>
<ModelVariables>
<ScalarVariable name="o_12" valueReference="0" causality="input" variability="continuous">
<Real unit="m" start="0"/></ScalarVariable>
<ScalarVariable name="guidance_o_12" valueReference="1" causality="input" variability="continuous">
<Real unit="m" start="0"/></ScalarVariable>
<ScalarVariable name="f_control_2" valueReference="2" causality="output" variability="continuous">
<Real unit="m/s2"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="3"/></Outputs></ModelStructure>
</fmiModelDescription>"""


@pytest.fixture
def campaign(tmp_path):
    """Write the quick start with replacements of text, which must be there."""

    def write(*changes, more=""):
        text = (ROOT / "campaigns" / "quickstart.toml").read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "mine.toml").write_text(text + more, encoding="utf-8")
        return tmp_path / "mine.toml"

    return write


@pytest.fixture
def third_party(campaign, tmp_path):
    """Write a campaign with a third-party controller, whose binary is none: it must never be loaded."""

    def write(*changes, platform=fmpy.platform, keys="", content=None):
        text = DESCRIPTION
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        with zipfile.ZipFile(tmp_path / "Mine.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", text)
            archive.writestr(f"binaries/{platform}/Mine{fmpy.sharedLibraryExtension}", b"never loaded")
        if content is not None:
            (tmp_path / "Mine.fmu").write_bytes(content)
        return campaign(more=f'\n[fmus.SuspensionControl]\npath = "Mine.fmu"\n{keys}')

    return write


@pytest.fixture
def tone(tmp_path):
    """Write a campaign of an hour in which a tone is injected, with an authority of 50 pN."""

    def write(amplitude, cycles):
        sine = ("guidance_o_12", "5 mHz", amplitude, cycles, "900 s")
        keys = 'duration = "1 h"\nnoise_duration = "1 h"'
        text = campaign_text.campaign(keys, sine, tables="[fit]\ninclude_short = true")
        (tmp_path / "mine.toml").write_text(text.replace("2200 pN", "50 pN"))
        return tmp_path / "mine.toml"

    return write


# Third-party FMUs -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["check", "run"])
def test_an_unknown_parameter_is_refused_whatever_the_fmus(lpfcosim, third_party, command):
    path = third_party()
    path.write_text(path.read_text(encoding="utf-8") + "[fit.parameters.lambda_q]\nvary = false\n")
    options = ("--trust",) if command == "run" else ()
    assert "lambda_q: no parameter of this fit" in refusal(lpfcosim(command, path, *options))


def test_what_rests_on_our_loop_is_not_available_with_another_one(
    lpfcosim, lpfcosim_json, third_party, monkeypatch
):
    monkeypatch.setattr(build, "build", None)  # none of ours is needed
    path = third_party()
    archive = path.with_name("Mine.fmu")
    _, out, err = lpfcosim("check", path, status=0)
    assert out.startswith(f"{path}: valid: 8 runs along x, 48 h\n")
    assert not re.search("drag_free_x|lambda_2", out)
    reason = f"not available, since the dynamics of {archive} are not known beforehand"
    assert reason in err
    assert f"{archive} is native code" in err
    assert "expected --trust" in err
    document = lpfcosim_json("check", path)
    assert (document["valid"], document["loops"], document["forecast"]) == (True, None, None)
    assert (document["peaks"], reason in document["unavailable"]) == ({}, True)
    status, out, err = lpfcosim("forecast", path, "--json")
    document = json.loads(out)
    assert (status, document["parameters"]) == (2, None)
    assert sentence(err) == f"{path}: {document['unavailable']}"
    for command, advice in (
        ("design", ""),
        ("montecarlo", "expected a simulation through the FMUs (fmus)"),
        ("forecast", "lpfcosim run"),
    ):
        refused = refusal(lpfcosim(command, path))
        assert reason in refused
        assert advice in refused


@pytest.mark.parametrize(
    ("changes", "options", "fault"),
    [
        ([], {"keys": 'variables = { f_control_2 = "forze" }\n'}, "variable 'forze' is missing"),
        ([], {"keys": "values = { gain = 2.0 }\n"}, "values names \"gain\", expected a parameter"),
        ([('"0" causality="input" variability="continuous">\n<Real unit="m"',
           '"0" causality="input" variability="continuous">\n<Real unit="nm"')], {}, "means 1e-09 m"),
        ([], {"content": b"no archive"}, "Mine.fmu: not a readable FMU"),
    ],
)  # fmt: skip
def test_fmu_that_does_not_fit_is_refused(lpfcosim, third_party, monkeypatch, changes, options, fault):
    monkeypatch.setattr(build, "build", None)  # refused before ours are built
    path = third_party(*changes, **options)
    refused = refusal(lpfcosim("check", path))
    assert refused.startswith(f"{path}: fmus.SuspensionControl")
    assert fault in refused


def test_every_command_that_simulates_refuses_alike_and_writes_nothing(lpfcosim, third_party, tmp_path):
    path = third_party(keys="values = { gain = 2.0 }\n")
    before = sorted(tmp_path.rglob("*"))
    sentences = {
        refusal(lpfcosim(command, path, *options, "--trust", "--out", "out"))
        for command, *options in (("run",), ("montecarlo", "--fmus"), ("identify",))
    }
    with pytest.raises(package.InputError) as refused:
        package.simulate(path, tmp_path / "out", trusted=True)
    assert sentences == {f"{path}: {str(refused.value).removeprefix(f'{path}: ')}"}
    assert sorted(tmp_path.rglob("*")) == before


# Commands at their limits -----------------------------------------------------------------------------------


def test_commands_that_stay_at_their_limits_are_refused(lpfcosim, tone, monkeypatch):
    monkeypatch.setattr(build, "build", None)
    refused = refusal(lpfcosim("check", tone("1 um", 13)))
    assert "run one: command f_x_2 reaches 3.25e-10 N at 1126 s" in refused
    assert 'F_max_2 of authority set "A" is 5e-11 N, beyond which it is for 66 % of the run' in refused


def test_a_step_beyond_the_range_of_the_interferometers_is_refused(lpfcosim, tone):
    path = tone("10 nm", 2)
    step = (
        'into = "guidance_o_12"\nshape = "half_cosine"\namplitude = "90 um"\nstart = "1000 s"\nend = "1001 s"'
    )
    path.write_text(f"{path.read_text()}\n[[experiments.injections]]\n{step}\n")
    assert re.search("o_12 reaches .* the range of the interferometers", refusal(lpfcosim("check", path)))


@pytest.mark.parametrize("name", ["quickstart", "mission-x", "spacecraft", "operations", "sweep", "designed"])
def test_shipped_campaigns_are_valid(quickstart, name):
    valid = validation.validate(loading.load(quickstart.with_name(f"{name}.toml")))
    assert (valid.doubts, valid.interfaces) == ((), ())


# Injections that a fit takes nothing from -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            'frequency = "0.833 mHz", amplitude = "10 nm", cycles = 4, start = "900 s"',
            'frequency = "0.833 Hz", amplitude = "10 nm", cycles = 4, start = "900 s"',
            "the sine of 833 mHz into guidance_o_12 from 900 s is above the fitted band, which "
            "ends at 100 mHz: no estimate takes anything from it",
        ),
        (
            'frequency = "53.3 mHz", amplitude = "0.7 nm", cycles = 32, start = "20941 s"',
            'frequency = "53.3 mHz", amplitude = "0.7 nm", cycles = 16, start = "21280 s"',
            "the sine of 53.3 mHz into guidance_o_1 from 21280 s is at an end of the run, where "
            "the window of the fit fades: 0.9 % of its power counts",
        ),
    ],
)
def test_injection_that_tells_a_fit_nothing_is_doubtful(lpfcosim, campaign, old, new, sentence):
    path = campaign((old, new))
    out = lpfcosim("check", path, "--json", status=0)[1]
    document, line = json.loads(out), f"warning: runs A, B, C, D: {sentence}"
    assert (document["valid"], f"warning: {document['warnings'][0]}") == (False, line)
    assert line in lpfcosim("forecast", path)[2].splitlines()


def test_short_runs_may_be_simulated_but_not_fitted(quickstart):
    plan = loading.load(quickstart)
    short = replace(plan.experiments[0], duration=600.0, noise_duration=600.0, injections=())
    short = replace(plan, experiments=(short,))
    assert validation.validate(short, fitted=False).doubts == ()
    with pytest.raises(InputError, match="runs A-noise, A: lasts 600 s, expected 1800 s or more"):
        validation.validate(short)
