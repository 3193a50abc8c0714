"""A campaign to start from, what the command check prints of it, and the JSON Schema of campaigns."""

import re
import tomllib

import jsonschema
import pytest

from lpfcosim.cli.new import json_schema
from lpfcosim.modelica import build


def test_new_then_check(lpfcosim, quickstart, tmp_path, monkeypatch):
    monkeypatch.setattr(build, "build", None)  # neither needs an FMU
    status, out, err = lpfcosim("new", "mine.toml")
    assert (status, err) == (0, "")
    assert "lpfcosim check mine.toml" in out
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    assert "lpfcosim run mine.toml" in text
    shipped = tomllib.loads(quickstart.read_text(encoding="utf-8"))
    assert tomllib.loads(text) == {**shipped, "name": "mine"}

    _, out, err = lpfcosim("check", "mine.toml", status=0)
    assert out.startswith("mine.toml: valid: 8 runs along x, 48 h\n")
    for row in (
        "A-noise +noise +2016-04-16 08:00 +6 +A +1",
        "D +sysid +2016-04-18 02:00 +6 +D +2 +10",
        r"drag_free_x +79\.\d+ mHz +45\.\d deg +14\.\d dB",
        r"delta_ifo_2 .* 2\.\de-07 .*",
    ):
        assert re.search(f"^ *{row} *$", out, flags=re.MULTILINE)
    assert "drag_free_y" not in out
    assert "warning: the data do not determine lambda_1, C_1: no run drives test mass 1" in err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["lpf-campaign.json", "mine.toml"]


# The schema -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def schema():
    result = json_schema()
    jsonschema.Draft202012Validator.check_schema(result)
    return result


def faults(schema, value):
    """Return the places of a campaign that break its schema."""
    result = jsonschema.Draft202012Validator(schema).iter_errors(value)
    return sorted({".".join(map(str, fault.absolute_path)) for fault in result})


@pytest.mark.parametrize("name", ["designed", "mission", "operations", "inertial", "lisa-ttl"])
def test_schema_allows_what_is_shipped(schema, quickstart, name):
    text = quickstart.with_name(f"{name}.toml").read_text(encoding="utf-8")
    assert faults(schema, tomllib.loads(text)) == []


@pytest.mark.parametrize(
    ("keys", "value", "fault"),
    [
        (("sequences", "standard", 0, "amplitude"), 1e-8, "sequences.standard.0"),
        (("noise", "omms"), "35 fm Hz^-0.5", "noise"),
        (("experiments", 0, "dcc"), "1e-12 m s^-2", "experiments.0"),
        (("fit",), {"estimator": "best"}, "fit.estimator"),
        (("nosie",), {}, ""),
    ],
)
def test_schema_knows_what_is_wrong(schema, quickstart, keys, value, fault):
    document = place = tomllib.loads(quickstart.read_text(encoding="utf-8"))
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    assert faults(schema, document) == [fault]
