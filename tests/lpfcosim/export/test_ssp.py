"""The SSP archive against its XML schema, through FMPy's reader, and against the network it says it holds."""

import tempfile
import zipfile
from collections import Counter
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import fmpy.ssp
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import get_connections, read_ssd, read_ssv
from lxml import etree

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from lpfcosim.export import ssp
from lpfcosim.modelica import build
from lpfcosim.models import SpacecraftModel, model_of, one_axis
from lpfcosim.spacecraft.run import Authority, Run
from tests import ROOT, third_party
from tests.campaign_text import ONE_EXPERIMENT
from tests.lpfcosim.modelica.modelica_source import fmu

pytestmark = pytest.mark.fmu

SCHEMAS = Path(fmpy.ssp.__file__).parent / "schema"
SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"

COMPONENTS = one_axis.MODEL.components(Run("run", "run", "sysid", 1, Authority("A", 0.0, 1.0, 1.0, 1.0)))


@pytest.fixture(scope="module")
def fmus():
    return build.build(fmi="2.0")


@pytest.fixture(scope="module")
def plan(quickstart):
    return loading.load(quickstart)


@pytest.fixture(scope="module")
def archive(fmus, plan, tmp_path_factory):
    path = tmp_path_factory.mktemp("ssp") / "folder" / "loop.ssp"
    assert ssp.export(plan, fmus, path) == path
    return path


@pytest.fixture(scope="module")
def members(archive):
    with zipfile.ZipFile(archive) as stored:
        return {name: stored.read(name) for name in stored.namelist()}


def structure(archive, variant="SystemStructure"):
    """A description of the archive, read by FMPy."""
    with zipfile.ZipFile(archive) as stored, tempfile.TemporaryDirectory() as folder:
        alone = Path(folder) / "alone.ssp"
        with zipfile.ZipFile(alone, "w") as target:
            target.writestr("SystemStructure.ssd", stored.read(f"{variant}.ssd"))
            for name in stored.namelist():
                if name.endswith(".ssv"):
                    target.writestr(name, stored.read(name))
        return read_ssd(str(alone)).system


def expected_connections(variant="open"):
    """(start element, start connector, end element, end connector), None for the system."""
    wanted = []
    for component in COMPONENTS:
        for variable, source in component.inputs.items():
            outside = None if variant == "open" else "Signals"
            start = tuple(source.split(".")) if "." in source else (outside, source)
            wanted.append((*start, component.model, variable))
    for channel, source in one_axis.MODEL.record.items():
        if "." in source and variant == "open":
            wanted.append((*source.split("."), None, channel))
    return wanted


@pytest.mark.parametrize("kind", ["ssd", "ssv"])
def test_fits_the_schema(members, kind):
    schema = {"ssd": "Description", "ssv": "ParameterValues"}[kind]
    schema = etree.XMLSchema(file=str(SCHEMAS / f"SystemStructure{schema}.xsd"))
    checked = [name for name in members if name.endswith(kind)]
    for name in checked:
        schema.assertValid(etree.parse(BytesIO(members[name])))
    assert len(checked) == {"ssd": 2, "ssv": 4}[kind]


def test_components_stand_in_the_order_of_the_steps(archive):
    driving, *elements = read_ssd(str(archive)).system.elements
    assert driving.name == "Signals"
    assert [e.name for e in elements] == [c.model for c in COMPONENTS]
    assert [e.name for e in structure(archive, "open").elements] == [c.model for c in COMPONENTS]
    for element, component in zip(elements, COMPONENTS, strict=True):
        kinds = {c.name: c.kind for c in element.connectors}
        assert kinds == dict.fromkeys(component.inputs, "input") | dict.fromkeys(component.outputs, "output")


def test_the_outside_is_signals_and_channels(plan, archive):
    system = structure(archive, "open")
    inputs = [c.name for c in system.connectors if c.kind == "input"]
    outputs = [c.name for c in system.connectors if c.kind == "output"]
    assert sorted(inputs) == sorted(model_of(plan.runs[0]).stimuli(plan.runs[0]))
    assert set(inputs) | set(outputs) == {
        *model_of(plan.runs[0]).stimuli(plan.runs[0]),
        *one_axis.MODEL.record,
    }
    assert not set(inputs) & set(outputs)


@pytest.mark.parametrize("variant", ["SystemStructure", "open"])
def test_every_connection_is_there_once(archive, variant):
    system = structure(archive, variant)
    found = [(c.startElement, c.startConnector, c.endElement, c.endConnector) for c in system.connections]
    assert Counter(found) == Counter(expected_connections(variant))
    ends = Counter((c.endElement, c.endConnector) for c in system.connections)
    assert set(ends.values()) == {1}


@pytest.mark.parametrize("variant", ["SystemStructure", "open"])
def test_no_input_is_left_unconnected(archive, variant):
    # A reader of FMPy's kind gives an unconnected input the source of the one before it.
    system = structure(archive, variant)
    ends = {(c.endElement, c.endConnector) for c in system.connections}
    for element in system.elements:
        for connector in element.connectors:
            assert connector.kind == "output" or (element.name, connector.name) in ends
    assert len(get_connections(system)) == len(system.connections)


def test_units_are_those_of_the_fmus_and_agree_along_connections(members, fmus):
    root = etree.fromstring(members["open.ssd"])
    units = {}
    for element in (root.find(f"{SSD}System"), *root.iter(f"{SSD}Component")):
        for connector in element.iterfind(f"{SSD}Connectors/{SSD}Connector"):
            name = element.get("name") if element.tag == f"{SSD}Component" else None
            units[name, connector.get("name")] = connector.find(f"{SSC}Real").get("unit")
    for start, output, end, variable in expected_connections():
        assert units[start, output] == units[end, variable] is not None
    for model, path in fmus.items():
        for variable in fmpy.read_model_description(str(path)).modelVariables:
            assert units.get((model, variable.name), variable.unit) == variable.unit
    newton = root.find(f"{SSD}Units/{SSC}Unit[@name='N']/{SSC}BaseUnit")
    assert dict(newton.attrib) == {"kg": "1", "m": "1", "s": "-2"}
    defined = [u.get("name") for u in root.iterfind(f"{SSD}Units/{SSC}Unit")]
    assert sorted(defined) == sorted(set(units.values()))


def test_fmus_inside_are_those_handed_in(members, fmus, archive):
    for element in structure(archive, "open").elements:
        assert members[element.source] == fmus[element.name].read_bytes()


def test_every_authority_set_has_its_values(archive, members, plan, fmus):
    known = {
        f"{model}.{v.name}": v.unit
        for model, path in (fmus | build.build(["Signals"], fmi="2.0")).items()
        for v in fmpy.read_model_description(str(path)).modelVariables
    }
    for name in ("A", "B", "C", "D"):
        run = next(r for r in plan.runs if r.authority.name == name)
        values = read_ssv(str(archive), f"resources/authority_{name}.ssv")
        wanted = {f"{m}.{n}": v for m, vs in model_of(run).parameters(run).items() for n, v in vs.items()}
        wanted["Signals.g_2_held"] = run.dc
        assert {p.name: float(p.value) for p in values.parameters} == wanted
        assert len(values.parameters) == len(wanted)
        for parameter in values.parameters:
            assert parameter.unit == known[parameter.name]
    assert sum(name.endswith(".ssv") for name in members) == 4


def test_first_authority_set_is_bound_to_the_system(archive, plan):
    system = read_ssd(str(archive)).system
    (binding,) = system.parameterBindings
    assert binding.source == f"resources/authority_{plan.runs[0].authority.name}.ssv"
    assert not binding.prefix
    # Each component has the same again, for tools that know no parameters of a system.
    values = {p.name: p.value for p in read_ssv(str(archive), binding.source).parameters}
    with zipfile.ZipFile(archive) as stored:
        root = etree.fromstring(stored.read("SystemStructure.ssd"))
    own = {
        f"{component.get('name')}.{p.get('name')}": p[0].get("value")
        for component in root.iter(f"{SSD}Component")
        for p in component.iter(f"{SSV}Parameter")
    }
    assert {name: float(v) for name, v in own.items()} == {name: float(v) for name, v in values.items()}


def test_fmpy_instantiates_parametrises_and_steps_it(archive):
    # A smoke test: FMPy steps Jacobi, so its numbers are not those of the loop.
    values = read_ssv(str(archive), "resources/authority_B.ssv")
    result = simulate_ssp(str(archive), stop_time=0.95, step_size=0.1, parameter_set=values)
    assert len(result) == 10
    assert all(np.isfinite(result[name]).all() for name in result.dtype.names)


def test_bytes_are_reproducible(archive, plan, fmus, tmp_path):
    again = ssp.export(plan, fmus, tmp_path / "again.ssp")
    assert again.read_bytes() == archive.read_bytes()
    assert list(tmp_path.iterdir()) == [again]


def test_experiments_that_share_a_set_share_a_file(fmus, tmp_path):
    plan = loading.load(ROOT / "tests" / "two_experiments.toml")
    path = ssp.export(plan, fmus, tmp_path / "loop.ssp")
    with zipfile.ZipFile(path) as stored:
        assert [n for n in stored.namelist() if n.endswith(".ssv")] == ["resources/authority_A.ssv"]
        root = etree.fromstring(stored.read("resources/authority_A.ssv"))
    assert "experiment first" in root.get("description")


def test_signal_that_feeds_two_components_is_one_connector(fmus, plan, tmp_path, monkeypatch):
    *others, plant = COMPONENTS
    plant = replace(plant, inputs={**plant.inputs, "g_2": "g_1"})
    monkeypatch.setattr(SpacecraftModel, "components", lambda *_: (*others, plant))
    system = structure(ssp.export(plan, fmus, tmp_path / "loop.ssp"), "open")
    assert [c.name for c in system.connectors].count("g_1") == 1
    assert sum(c.startConnector == "g_1" for c in system.connections) == 2


def test_fmi_3_is_refused(fmus, plan, tmp_path):
    newer = build.build(["Plant"], fmi="3.0")
    with pytest.raises(InputError, match=r"fmi3/Plant\.fmu: is FMI 3\.0; SSP 1\.0 takes FMI 2\.0"):
        ssp.export(plan, {**fmus, **newer}, tmp_path / "loop.ssp")
    assert list(tmp_path.iterdir()) == []


def test_arrays_are_refused(tmp_path):
    mine = fmu(
        tmp_path,
        """model M "Own"
          input Real y[2](each unit = "m") "Read-out, set point"; output Real u(unit = "m/s2") "Force";
        equation
          u = -1e-6*(y[1] - y[2]);
        end M;""",
    )
    file = tmp_path / "own.toml"
    file.write_text(
        f"""schema = "lpf-campaign/1"\nname = "own"\nseed = 3
        [fmus.SuspensionControl]
        path = "{mine.name}"
        variables = {{ o_12 = "y[1]", guidance_o_12 = "y[2]", f_control_2 = "u" }}
        {ONE_EXPERIMENT}duration = "60 s"\nnoise_duration = "60 s"
        """
    )
    newer = build.build([c.model for c in COMPONENTS])
    with pytest.raises(InputError, match=r"M\.fmu: 'y\[1\]' is an element of an array; an exported system"):
        ssp.export(loading.load(file), {**newer, "SuspensionControl": mine}, tmp_path / "loop.ssp", "2.0")
    assert not (tmp_path / "loop.ssp").exists()


def test_missing_variable_is_told(fmus, plan, tmp_path):
    with pytest.raises(
        InputError, match=r"Control\.fmu: variable 'x_1' is missing; expected of the OpticalMetrology"
    ):
        ssp.export(plan, {**fmus, "OpticalMetrology": fmus["SuspensionControl"]}, tmp_path / "loop.ssp")


def test_unreadable_fmu_is_told(fmus, plan, tmp_path):
    broken = tmp_path / "broken.fmu"
    broken.write_bytes(b"not a zip archive")
    with pytest.raises(InputError, match=r"broken\.fmu: not a readable FMU"):
        ssp.export(plan, {**fmus, "Plant": broken}, tmp_path / "loop.ssp")


def test_units_of_one_name_must_mean_the_same(fmus, plan, tmp_path):
    other = tmp_path / "other.fmu"
    with zipfile.ZipFile(fmus["DragFreeControl"]) as stored, zipfile.ZipFile(other, "w") as changed:
        for name in stored.namelist():
            content = stored.read(name)
            if name == "modelDescription.xml":
                content = content.replace(b'<BaseUnit rad="1" s="-1" />', b'<BaseUnit s="-1" />')
                assert content != stored.read(name)
            changed.writestr(name, content)
    with pytest.raises(InputError, match=r": unit 'rad/s' is not what another FMU means by it"):
        ssp.export(plan, {**fmus, "DragFreeControl": other}, tmp_path / "loop.ssp")


@pytest.mark.parametrize(("version", "fmi"), [("1.0", "2.0"), ("2.0", "3.0")])
def test_values_are_written_with_their_types(fmus, tmp_path, version, fmi):
    third_party.built(tmp_path, fmi=fmi)
    values = "values = { mode = 2, enabled = false, label = 'half', law = 2, state = 1e-9 }"
    file = tmp_path / "own.toml"
    head = 'schema = "lpf-campaign/1"\nname = "own"\nseed = 3\n'
    file.write_text(f'{head}{third_party.TABLE}{values}\n{ONE_EXPERIMENT}duration = "60 s"\n')
    others = build.build([c.model for c in COMPONENTS], fmi=fmi)
    archives = {**others, "SuspensionControl": tmp_path / "ThirdParty.fmu"}
    written = ssp.export(loading.load(file), archives, tmp_path / "loop.ssp", version)
    with zipfile.ZipFile(written) as archive:
        name = next(n for n in archive.namelist() if n.endswith(".ssv"))
        root = etree.fromstring(archive.read(name))
    found = {}
    for parameter in root.iter(f"{{{root.tag[1:].partition('}')[0]}}}Parameter"):
        (typed,) = parameter
        found[parameter.get("name").removeprefix("SuspensionControl.")] = (
            typed.tag.partition("}")[2],
            typed.get("value"),
        )
    real = "Real" if fmi == "2.0" else "Float64"
    assert found["mode"] == ("Integer" if fmi == "2.0" else "UInt8", "2")
    assert found["enabled"] == ("Boolean", "false")
    assert found["label"] == ("String", "half")
    assert found["law"] == ("Enumeration", "stiff")
    assert found["state"] == (real, "1e-09")
    assert found["bandwidth"] == (real, "0.001")
