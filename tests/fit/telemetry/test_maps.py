"""Maps: their schema and their faults, the draft to start from, and what points to them."""

import json
import re
import shlex
import tomllib

import h5py
import jsonschema
import numpy as np
import pytest
from scipy.io import savemat

import fit
from fit.errors import InputError
from fit.telemetry import map_draft, maps
from fit.telemetry.contract import ATTRIBUTES, CHANNELS

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

[[runs]]
file = ["A.csv", "B.csv"]
run = "A"
experiment = "A"
kind = "sysid"

[[runs]]
file = { o_1 = "A.csv", o_12 = "A.csv", f_x_1 = "A.csv", f_x_2 = "A.csv", time = "B.csv" }
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


def test_all_that_a_map_may_say(written):
    loaded = maps.load(written(MAP))
    assert loaded.missing == [-9999.0, 1e20] and loaded.channels["o_1"].missing == [-1.0]
    assert maps.attributes_of(written(MAP), loaded, 0)["F_max_2"] == 2.2e-9


FAULTS = {
    "column 0": ("column = 1", "column = 0", "time.column: 0 is no column, expected its name"),
    "no column": ("column = 2, ", "", "channels.o_1: expected its column"),
    "format": ('"gps"', '"GPS"', 'time.format: "GPS" is not known, did you mean "gps"?'),
    "scale of a format with its own": (
        '"gps"',
        '"gps"\nscale = "utc"',
        "time.scale: 'utc', expected none: 'gps' has a scale of its own",
    ),
    "unit of days": ('"gps"', '"mjd"\nunit = "d"', "time.unit: 'd', expected none with format 'mjd'"),
    "marker": ("missing = -1", 'missing = "n/a"', 'channels.o_1.missing: "n/a" is no number'),
    "no file": ('["A.csv", "B.csv"]', "[]", "runs[0].file: [] is no file, expected a name"),
    "no such file": ('"{run}_{channel}.txt"', '"{channel}.txt"', "runs[0].file: 'o_12.txt', no such file"),
    "file of no channel": (
        "file = { o_1 =",
        "file = { o_2 =",
        'runs[1].file.o_2: not known, did you mean "o_12"?',
    ),
    "channel of no file": (
        '{ o_1 = "A.csv", ',
        "{ ",
        "runs[1].file.o_1: missing, expected the file of its column",
    ),
    "run": ('run = "A"', 'run = "../A"', 'runs[0].run: "../A" cannot name a file, expected the unique name'),
    "attribute": ("m_tm", "m_TM", 'attributes.m_TM: not known, did you mean "m_tm"?'),
    "truth value of a mass": ('m_tm = "1.928 kg"', "m_tm = true", "attributes.m_tm: true, expected a number"),
    "unit of a velocity": (
        '"pN"',
        '"m/s"',
        "channels.f_x_1.unit: unit 'm/s' does not measure what 'm s-2' does",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_a_map(written, fault):
    old, new, expected = FAULTS[fault]
    assert old in MAP
    with pytest.raises(InputError) as refused:
        maps.load(written(MAP.replace(old, new, 1)))
    message = str(refused.value)
    assert f"map.toml: {expected}" in message, message
    assert "\n" not in message and not re.search("pydantic|pattern|valid|isoformat", message)


@pytest.mark.parametrize("old", ['"1.928 kg"', "[-9999, 1e20]"])
def test_an_integer_beyond_all_floats(written, old):
    with pytest.raises(InputError, match="larger than any float, expected"):
        maps.load(written(MAP.replace(old, 400 * "9", 1)))


#: No start of a run, as TOML has it, and what a message must say of it; local time without an offset is UTC.
BAD_T0 = {
    '"yesterday"': "'yesterday' is not a time",
    "1460815200": "1460815200 is not a text",
    "2016-04-16": "'2016-04-16' is a date without the time",
    "[2016, 4, 16]": "[2016, 4, 16], expected a number or a text",
}


@pytest.mark.parametrize("t0", BAD_T0)
def test_a_bad_start(written, tmp_path, t0):
    with pytest.raises(InputError) as refused:
        maps.load(written(re.sub("t0 = .*", f"t0 = {t0}", MAP)))
    message = str(refused.value)
    assert BAD_T0[t0] in message and "expected" in message
    assert not re.search("isoformat|pydantic|out of range", message)


# The JSON Schema -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def schema():
    loaded = json.loads(json.dumps(map_draft.json_schema()))
    jsonschema.Draft202012Validator.check_schema(loaded)
    return loaded


def broken(schema, document):
    loaded = jsonschema.Draft202012Validator(schema).iter_errors(
        json.loads(json.dumps(document, default=str))
    )
    return sorted({".".join(map(str, fault.absolute_path)) for fault in loaded})


def test_the_schema_takes_what_the_reader_takes(schema):
    assert broken(schema, tomllib.loads(MAP)) == []
    assert broken(schema, tomllib.loads(map_draft.draft("map.toml", [], None))) == []


@pytest.mark.parametrize(
    "fault",
    sorted(
        FAULTS.keys()
        - {"no column", "no such file", "file of no channel", "channel of no file", "truth value of a mass"}
    ),
)
def test_the_schema_sees_what_the_reader_refuses(schema, fault):
    old, new, expected = FAULTS[fault]
    faults = broken(schema, tomllib.loads(MAP.replace(old, new, 1)))
    of_values = ("unit of", "scale of", "run", "no file")
    assert faults or fault.startswith(of_values), expected


def test_the_schema_knows_channels_and_attributes(schema):
    properties = schema["properties"]
    assert properties["channels"]["properties"].keys() == CHANNELS.keys()
    assert properties["attributes"]["properties"].keys() == ATTRIBUTES.keys()
    assert ATTRIBUTES.keys() <= schema["$defs"]["Source"]["properties"].keys()


# The draft -----------------------------------------------------------------------------------------------

N = 30
COLUMNS = {"t": np.arange(N) / 10} | {name: np.arange(N) % 7.0 for name in ("o_1", "o_12", "f_x_1", "f_x_2")}


def as_csv(path, names, columns=COLUMNS, stamps=None):
    rows = np.column_stack(list(columns.values())).tolist()
    if stamps is not None:
        rows = [[stamp, *row[1:]] for stamp, row in zip(stamps, rows, strict=True)]
    lines = [",".join(names), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_a_draft_of_an_archive_with_stamps_is_a_map(lpfcosim, tmp_path):
    names = ("UTC", "OMS_x1 [nm]", "OMS_x12 [nm]", "f_x_1 [pm/s^2]", "f_x_2 [pm/s^2]")
    for run, hour in (("E7", 14), ("E7-noise", 8)):
        stamps = [f"2016-04-16T{hour:02}:00:{k / 10:04.1f}Z" for k in range(N)]
        as_csv(tmp_path / f"{run}.csv", names, stamps=stamps)
    status, out, err = lpfcosim("new", "--map", "E7.csv", "E7-noise.csv")
    assert (status, err) == (0, "")
    assert out == "E7.toml: written; fill it in, then: lpfcosim fit E7.toml\n"
    text = (tmp_path / "E7.toml").read_text(encoding="utf-8")
    assert (
        text.startswith("#:schema ./lpf-map.json\n") and map_draft.BLANK not in tomllib.loads(text).values()
    )
    assert json.loads((tmp_path / "lpf-map.json").read_text(encoding="utf-8")) == map_draft.json_schema()
    noise, sysid = fit.load(tmp_path / "E7.toml", tmp_path / "out")
    assert (noise.run, noise.kind, noise.t0) == ("E7-noise", "noise", "2016-04-16T08:00:00Z")
    assert (sysid.run, sysid.kind, sysid.t0) == ("E7", "sysid", "2016-04-16T14:00:00Z")
    assert sysid.experiment == noise.experiment == "E7"
    np.testing.assert_allclose(sysid.channels["o_12"], 1e-9 * COLUMNS["o_12"])
    np.testing.assert_allclose(sysid.channels["f_x_2"], 1e-12 * COLUMNS["f_x_2"])
    status, _, err = lpfcosim("new", "--map", "E7.csv")
    assert status == 2 and "E7.toml: exists already, expected a new name" in err


def as_hdf5(path):
    with h5py.File(path, "w") as file:
        for name, values in COLUMNS.items():
            file[f"oms/{name}"] = values


WRITERS = {
    "A.csv": lambda path: as_csv(path, COLUMNS),
    "A.mat": lambda path: savemat(path, {"data": COLUMNS}),
    "A.h5": as_hdf5,
}


@pytest.mark.parametrize("name", WRITERS)
def test_an_archive_without_a_map_points_to_one(lpfcosim, tmp_path, name):
    WRITERS[name](tmp_path / name)
    status, out, err = lpfcosim("fit", name)
    assert (status, out) == (2, "")
    (sentence,) = err.splitlines()
    assert sentence.startswith(f"lpfcosim: error: {name}: ")
    command = sentence.partition("write a map: lpfcosim ")[2]
    status, _, err = lpfcosim(*shlex.split(command))
    assert (status, err) == (0, "")
    (path,) = tmp_path.glob("*.toml")
    with pytest.raises(InputError, match=r"runs\[0\]: attribute t0: 'FILL IN' is not a time"):
        fit.load(path, tmp_path / "out")
    path.write_text(path.read_text().replace('t0 = "FILL IN"', "t0 = 2016-04-16T14:00:00Z"))
    (run,) = fit.load(path, tmp_path / "out")
    assert run.fs == 10.0
    np.testing.assert_array_equal(run.channels["f_x_1"], COLUMNS["f_x_1"])


def test_a_draft_of_a_file_for_each_channel(lpfcosim, tmp_path):
    runs = ("E7", "E7_noise")
    names = [f"{run}_{channel}.txt" for run in runs for channel in COLUMNS if channel != "t"]
    for name in names:
        columns = [COLUMNS["t"], COLUMNS[name.partition(".")[0].removeprefix("E7_").removeprefix("noise_")]]
        np.savetxt(tmp_path / name, np.column_stack(columns))
    assert lpfcosim("new", "--map", "all.toml", *names)[0] == 0
    text = (tmp_path / "all.toml").read_text(encoding="utf-8")
    assert [run["file"] for run in tomllib.loads(text)["runs"]] == ["{run}_{channel}.txt"] * 2
    (tmp_path / "all.toml").write_text(text.replace('"FILL IN"', "2016-04-16T14:00:00Z"))
    loaded = fit.load(tmp_path / "all.toml", tmp_path / "out")
    assert [(run.run, run.experiment, run.kind) for run in loaded] == [
        ("E7", "E7", "sysid"),
        ("E7_noise", "E7", "noise"),
    ]
    for run in loaded:
        for channel in run.channels:
            np.testing.assert_array_equal(run.channels[channel], COLUMNS[channel])


def test_a_draft_lists_what_it_does_not_recognise(lpfcosim, tmp_path):
    as_csv(tmp_path / "A.csv", ("clock", "ifo", "difference", "a", "b"))
    assert lpfcosim("new", "--map", "mine.toml", "A.csv")[0] == 0
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    assert '#   "difference" ' in text
    document = tomllib.loads(text)
    assert [c["column"] for c in document["channels"].values()] == ["FILL IN"] * 4
    assert document["attributes"].get("fs", document.get("fs")) == "FILL IN"
    status, _, err = lpfcosim("fit", "mine.toml")
    assert status == 2 and "mine.toml: attributes.fs: 'FILL IN', no number with a unit" in err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("none.csv",), "none.csv: no such file"),
        (("a.toml", "b.toml"), "b.toml: expected one name that ends in .toml, and archives"),
        (("notes.docx",), "notes.docx: of no known format"),
        (("nowhere/a.toml",), "nowhere is not a folder"),
    ],
)
def test_new_map_refuses(lpfcosim, tmp_path, arguments, expected):
    (tmp_path / "notes.docx").touch()
    status, out, err = lpfcosim("new", "--map", *arguments)
    assert (status, out) == (2, "")
    (sentence,) = err.splitlines()
    assert expected in sentence
    assert [path.name for path in tmp_path.iterdir()] == ["notes.docx"]


def test_the_commands_without_archives(lpfcosim, tmp_path):
    assert lpfcosim("new", "--map")[0] == 0
    document = tomllib.loads((tmp_path / "map.toml").read_text(encoding="utf-8"))
    for run in document["runs"]:
        (tmp_path / run["file"]).touch()
    with pytest.raises(InputError, match=r"attribute t0: 'FILL IN'"):
        maps.load(tmp_path / "map.toml")
    status, out, err = lpfcosim("schema", "--map")
    assert (status, err, json.loads(out)) == (0, "", map_draft.json_schema())
    status, _, err = lpfcosim("new", "a.toml", "A.csv")
    assert (
        status == 2 and "A.csv: expected one name; archives are described by a map: lpfcosim new --map" in err
    )
