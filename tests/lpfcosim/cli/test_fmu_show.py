"""The command fmu show: what a place needs, what a file has, and how the two fit."""

import json
import tomllib

import pytest

from lpfcosim.models import model_of
from tests import third_party

pytestmark = pytest.mark.fmu


def test_a_place_and_all_that_it_needs(lpfcosim, make_run):
    status, out, _ = lpfcosim("fmu", "show", "SuspensionControl", "--json")
    document = json.loads(out)
    assert (status, document["schema"]) == (0, "lpf-fmu/1")
    needs = {need["name"]: need for need in document["place"]["variables"]}
    run = make_run()
    (component,) = (c for c in model_of(run).components(run) if c.model == "SuspensionControl")
    parameters = model_of(run).parameters(run)["SuspensionControl"]
    assert set(needs) == {*component.inputs, *component.outputs, *parameters}
    assert needs["f_u"] == {
        "name": "f_u", "causality": "parameter", "unit": "Hz", "default": parameters["f_u"],
        "description": "Unity gain of the nominal loop", "optional": False,
    }  # fmt: skip
    out = lpfcosim("fmu", "show", "Actuation", status=0)[1]
    assert "input (optional)  e_x_1" in out


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_a_file_and_all_that_it_has(lpfcosim, tmp_path, fmi):
    archive = third_party.built(tmp_path, fmi=fmi)
    status, out, _ = lpfcosim("fmu", "show", archive, "--json")
    file = json.loads(out)["file"]
    assert (status, file["fmi"], file["tool"], file["faults"]) == (0, fmi, "By hand", [])
    by_name = {variable["name"]: variable for variable in file["variables"]}
    assert by_name["law"]["items"] == ["standard", "stiff"]
    assert by_name["bandwidth"]["unit"] == "Hz"
    status, out, _ = lpfcosim("fmu", "show", archive)
    assert "Enumeration (standard, stiff)" in out
    assert "local variable" in out


def test_a_proposal_that_a_campaign_takes(lpfcosim, tmp_path):
    names = [('name="distance"', 'name="o12"'), ('name="wanted"', 'name="guidance_o12"')]
    archive = third_party.built(tmp_path, changes=names)
    out = lpfcosim("fmu", "show", archive, "SuspensionControl", status=0)[1]
    table = tomllib.loads(out[out.index("[fmus.") :])["fmus"]["SuspensionControl"]
    expected = {"o_12": "o12", "guidance_o_12": "guidance_o12", "f_control_2": "force", "f_x_2_start": "hold"}
    assert table["variables"] == expected
    assert table["unused"] == ["h", "f_u", "f_z", "f_i", "f_p", "f_r"]
    assert '# its own parameters, for variables or values: "bandwidth"' in out


def test_names_that_only_the_user_can_tell_apart(lpfcosim, tmp_path):
    out = lpfcosim("fmu", "show", "SuspensionControl", third_party.built(tmp_path), status=1)[1]
    assert '# o_12 = "distance" or "wanted": to be added to variables' in out


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (["Suspension"], 'no place "Suspension" in the loop, did you mean "SuspensionControl"?'),
        (["nothing.fmu"], "nothing.fmu: not a readable FMU: No such file or directory"),
        (["Plant", "Actuation"], "expected a place of the loop, an FMU, or one of each"),
    ],
)
def test_what_is_neither(lpfcosim, given, sentence):
    err = lpfcosim("fmu", "show", *given, status=2)[2]
    assert sentence in err
