"""What else an archive holds: documentation, licence, icon, terminal, related files."""

import hashlib
import io
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from lxml import etree
from PIL import Image

from lpfcosim.campaign import loading
from lpfcosim.modelica import build
from tests.lpfcosim.modelica.modelica_source import fmu

pytestmark = pytest.mark.fmu

SCHEMAS = Path(fmpy.__file__).parent / "schema" / "fmi3"
LS = "{http://fmi-standard.org/fmi-ls-manifest}"
AUTHORITY = ("F_max_1", "F_max_2", "N_max_1", "N_max_2")
MISSION_X = loading.load(Path(__file__).parents[3] / "campaigns" / "mission-x.toml")
RELATED = "extra/org.fmi-standard.fmi-ls-ref/"
CASES = [
    pytest.param(model, version, marks=() if model in ("Plant", "Actuation") else pytest.mark.slow)
    for model in (*build.MODELS, *build.SIGNALS)
    for version in ("2.0", "3.0")
]


def manifest(found):
    return etree.fromstring(found[f"{RELATED}fmi-ls-manifest.xml"])


def members(model, version):
    with zipfile.ZipFile(build.build([model], fmi=version)[model]) as stored:
        return {name: stored.read(name) for name in stored.namelist()}


@pytest.mark.parametrize(("model", "version"), CASES)
def test_documentation_has_every_variable_equations_and_the_licence(model, version):
    found = members(model, version)
    page = etree.fromstring(found["documentation/index.html"], etree.HTMLParser())
    shown = {row[0].text for row in page.iter("tr")}
    described = etree.fromstring(found["modelDescription.xml"]).find("ModelVariables")
    assert {v.get("name") for v in described} - {"time"} <= shown
    assert "Redistribution and use" in found["documentation/licenses/license.txt"].decode()
    for link in page.iter("a"):
        assert f"documentation/{link.get('href')}" in found
    if model == "Plant":
        text = " ".join(pre.text for pre in page.iter("pre"))
        assert "spacecraft.a_SC = (" in text
        assert "delay(f_applied_1, -h/2 + tau_1)" in text


@pytest.mark.parametrize(("model", "version"), CASES)
def test_icon_and_terminal(model, version):
    found = members(model, version)
    if version == "2.0":
        assert Image.open(io.BytesIO(found["model.png"])).size == (96, 64)
        return
    icon = Image.open(io.BytesIO(found["terminalsAndIcons/icon.png"]))
    icon.load()  # checks the sums
    assert icon.size == (96, 64)
    assert icon.getpixel((48, 20)) == (245, 247, 250, 255)
    assert icon.getpixel((0, 0))[3] == 0
    assert etree.fromstring(found["terminalsAndIcons/icon.svg"]).tag.endswith("svg")
    root = etree.fromstring(found["terminalsAndIcons/terminalsAndIcons.xml"])
    etree.XMLSchema(file=str(SCHEMAS / "fmi3TerminalsAndIcons.xsd")).assertValid(root)
    variables = etree.fromstring(found["modelDescription.xml"]).find("ModelVariables")
    outside = {v.get("name") for v in variables if v.get("causality") in ("input", "output")}
    members_ = [(m.get("variableName"), m.get("memberName")) for m in root.iter("TerminalMemberVariable")]
    assert members_ and {m[0] for m in members_} == outside
    assert all(a == b for a, b in members_)


@pytest.mark.parametrize(("model", "version"), CASES)
def test_related_files_are_there_and_as_they_were_signed(model, version):
    found = members(model, version)
    root = manifest(found)
    assert root.tag == "fmiReferences"
    assert root.get(f"{LS}fmi-ls-name") == "org.fmi-standard.fmi-ls-ref"
    assert root.get(f"{LS}fmi-ls-version") == "1.0.0-alpha.1"
    related = {r.get("source"): r.get("role") for r in root}
    assert {f"{RELATED}{source}" for source in related} <= set(found)
    assert set(related.values()) >= {"model", "signature", "experiment/smoke-test", "result"}
    assert ("testcase" in related.values()) == (model not in build.SIGNALS)  # these have no inputs
    own = {p.name for p in build.PACKAGE.rglob("*.mo")}
    assert {Path(s).name for s, role in related.items() if role == "model"} == own
    for source, role in related.items():
        if role == "model":
            assert found[RELATED + source] == (build.PACKAGE / Path(source).name).read_bytes()
    lines = found[f"{RELATED}SHA256SUMS"].decode().splitlines()
    sums = {name: digest for digest, name in (line.split("  ") for line in lines)}
    assert set(sums) == set(found) - {f"{RELATED}SHA256SUMS"}
    for name, digest in sums.items():
        assert hashlib.sha256(found[name]).hexdigest() == digest


def read(folder, name, content):
    (folder / name).write_bytes(content)
    return fmpy.util.read_csv(folder / name)


def parameters(found, name):
    root = etree.fromstring(found[f"{RELATED}{name}"])
    return {p.get("name"): p[0].get("value") for p in root[0]}


@pytest.mark.parametrize(("model", "version"), CASES)
def test_experiments_give_their_results_again(tmp_path, model, version):
    found = members(model, version)
    root = etree.fromstring(found[f"{RELATED}smoke-test.exp"])
    assert root.tag == "Experiments" and root.get("name")
    results = {}
    for told in root:
        stimuli, values = told.find("Stimuli"), told.find("Parameters")
        wanted = read(tmp_path, "wanted.csv", found[RELATED + told.find("References").get("source")])
        result = fmpy.simulate_fmu(
            str(build.build([model], fmi=version)[model]),
            start_time=float(told.get("startTime")), stop_time=float(told.get("stopTime")),
            output_interval=float(told.get("stepSize")),
            start_values={} if values is None else parameters(found, values.get("source")),
            input=None if stimuli is None else read(tmp_path, "in.csv", found[RELATED + "input.csv"]),
            output=list(wanted.dtype.names[1:]),
        )  # fmt: skip
        assert len(wanted) == 101
        for name in wanted.dtype.names:
            np.testing.assert_allclose(
                result[name], wanted[name],
                rtol=0, atol=float(told.get("tolerance")) * np.abs(wanted[name]).max(),
            )  # fmt: skip
        results[told.get("name")] = wanted
        if model == "Plant":
            assert all(wanted[name].any() for name in wanted.dtype.names)
    authority = model in ("Plant", "WholePlant", "Actuation", "WholeActuation")
    assert list(results) == ["start", *("ABCDEFG" if authority else "")]
    if model == "Plant":  # the stiffness follows the authority
        assert (results["D"]["x_2"] != results["A"]["x_2"]).any()


@pytest.mark.parametrize("name", "ABCDEFG")
def test_sets_of_parameters_are_those_of_the_campaigns(name):
    authority = next(r.authority for r in MISSION_X.runs if r.authority.name == name)
    found = members("Plant", "2.0")
    start = parameters(found, "start.ssv")
    told = parameters(found, f"parameters_authority_{name}.ssv")
    assert set(told) == set(start)
    assert {key for key in told if told[key] != start[key]} <= set(AUTHORITY)
    assert {key: float(told[key]) for key in AUTHORITY} == pytest.approx(
        {key: getattr(authority, key) for key in AUTHORITY}, rel=1e-15
    )
    labels = {r.get("source"): [x.get("name") for x in r] for r in manifest(found)}
    assert labels[f"parameters_authority_{name}.ssv"] == [f"authority:{name}"]
    assert labels[f"result_authority_{name}.csv"] == [f"authority:{name}"]


@pytest.mark.parametrize(("model", "version"), CASES)
def test_start_values_are_a_set_of_parameters(model, version):
    found = members(model, version)
    variables = etree.fromstring(found["modelDescription.xml"]).find("ModelVariables")
    parameters = {v.get("name"): v for v in variables if v.get("causality") == "parameter"}
    if not parameters:
        assert f"{RELATED}start.ssv" not in found
        return
    root = etree.fromstring(found[f"{RELATED}start.ssv"])
    schema = Path(fmpy.__file__).parent / "ssp" / "schema" / "SystemStructureParameterValues.xsd"
    etree.XMLSchema(file=str(schema)).assertValid(root)
    values = {p.get("name"): p[0] for p in root[0]}
    assert set(values) == set(parameters)
    for name, v in parameters.items():
        attributes = {**v.attrib, **(v[0].attrib if len(v) else {})}
        assert values[name].get("value") == attributes["start"]
        assert values[name].get("unit") == attributes.get("unit")


def test_model_that_does_not_run_as_it_starts_has_no_result(tmp_path):
    path = fmu(
        tmp_path,
        """model M
          parameter Real T = 0 "Lag"; input Real u; output Real x(start = 0, fixed = true);
        equation
          T*der(x) = u - x;
        end M;""",
    )
    with zipfile.ZipFile(path) as stored:
        names = stored.namelist()
        assert not any(name.endswith(("result.csv", ".exp", "input.csv")) for name in names)
        assert f"{RELATED}fmi-ls-manifest.xml" in names
