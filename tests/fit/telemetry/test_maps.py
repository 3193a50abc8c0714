"""Maps: their schema and their faults, the template, and what points to it."""

import json
import re
import shlex
import tomllib

import jsonschema
import numpy as np
import pytest

import fit
from fit.errors import InputError
from fit.telemetry import maps

MAP = """\
schema = "lpf-map/1"
missing = [-9999, 1e20]

[attributes]
m_tm = "1.928 kg"
F_max_1 = "0 N"
F_max_2 = "2200 pN"
N_max_1 = "10.4 pN m"
N_max_2 = "10.4 pN m"
alignment_epoch = 1

[time]
column = 1
format = "gps"

[channels]
o_1 = { column = 2, unit = "nm", missing = -1 }
o_12 = { column = "out[2]", file = "{run}_{channel}.txt" }
f_x_1 = { column = "a1", unit = "pN" }
f_x_2 = { column = "a2", table = "{channel}" }
N_phi_1 = { value = 0 }

[text]
delimiter = ";"
decimal = ","
header = 3

[[runs]]
file = "A.csv"
run = "A"
experiment = "A"
kind = "sysid"

[[runs]]
file = "B.csv"
table = 1
run = "B"
experiment = "A"
kind = "noise"
t0 = 2016-04-16T14:00:00Z
"""


@pytest.fixture
def written(tmp_path):
    for name in ("A.csv", "B.csv", "A_o_12.txt", "B_o_12.txt"):
        (tmp_path / name).touch()

    def write(text):
        (tmp_path / "map.toml").write_text(text, encoding="utf-8")
        return tmp_path / "map.toml"

    return write


FAULTS = {
    "no column": ("column = 2, ", "", "channels.o_1: expected its column"),
    "format": ('"gps"', '"GPS"', 'time.format: "GPS" is not known, did you mean "gps"?'),
    "unit of days": ('"gps"', '"mjd"\nunit = "d"', "time.unit: \"d\", expected none with format 'mjd'"),
    "attribute": ("m_tm", "m_TM", 'attributes.m_TM: not known, did you mean "m_tm"?'),
    "start without time": (
        "2016-04-16T14:00:00Z",
        "2016-04-16",
        "attribute t0: '2016-04-16', expected date and time",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_a_map(written, fault):
    old, new, expected = FAULTS[fault]
    assert old in MAP
    with pytest.raises(InputError) as refused:
        maps.load(written(MAP.replace(old, new, 1)))
    message = str(refused.value)
    assert "map.toml: " in message and expected in message, message
    assert "\n" not in message and not re.search("pydantic|pattern|isoformat", message)


@pytest.fixture(scope="module")
def schema():
    loaded = json.loads(json.dumps(maps.json_schema()))
    jsonschema.Draft202012Validator.check_schema(loaded)
    return jsonschema.Draft202012Validator(loaded)


def test_the_json_schema_takes_what_the_reader_takes(schema):
    for text in (MAP, maps.template("map.toml")):
        schema.validate(json.loads(json.dumps(tomllib.loads(text), default=str)))


def test_an_archive_without_a_map_points_to_the_template(lpfcosim, tmp_path):
    name = "A.csv"
    columns = {"t": np.arange(30) / 10, **{c: np.arange(30) % 7.0 for c in ("x1", "x12", "a1", "a2")}}
    rows = np.transpose(list(columns.values()))
    np.savetxt(tmp_path / name, rows, "%.17g", ",", header=",".join(columns))
    status, out, err = lpfcosim("fit", name)
    assert (status, out) == (2, "")
    (sentence,) = err.splitlines()
    assert sentence.startswith(f"lpfcosim: error: {name}: ")
    status, out, err = lpfcosim(*shlex.split(sentence.partition("described by a map: lpfcosim ")[2]))
    assert (status, err, out) == (0, "", "A.toml: written; fill it in, then: lpfcosim fit A.toml\n")
    text = (tmp_path / "A.toml").read_text(encoding="utf-8")
    assert text.startswith("#:schema ./lpf-map.json\n")
    assert json.loads((tmp_path / "lpf-map.json").read_text(encoding="utf-8")) == maps.json_schema()
    with pytest.raises(InputError, match=r"runs\[0\]: attribute t0: 'FILL IN', expected date and time"):
        fit.load(tmp_path / "A.toml", tmp_path / "out")
    head, run, _ = text.split("\n[[runs]]\n")
    run = run.replace('t0 = "FILL IN"', "t0 = 2016-04-16T14:00:00Z").replace("FILL IN", name)
    text = f"{head}\n[[runs]]\n{run}"
    for ours, theirs in {"OMS_x12": "x12", "OMS_x1": "x1", "a1_cmd": "a1", "a2_cmd": "a2"}.items():
        text = text.replace(ours, theirs)
    (tmp_path / "A.toml").write_text(text, encoding="utf-8")
    (run,) = fit.load(tmp_path / "A.toml", tmp_path / "out")
    assert run.fs == 10.0
    np.testing.assert_array_equal(run.channels["f_x_1"], columns["a1"])
