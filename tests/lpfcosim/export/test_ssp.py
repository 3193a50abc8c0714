"""The SSP archive against its XML schema, through FMPy's reader, and against the network it says it holds."""

import zipfile
from collections import Counter
from io import BytesIO
from pathlib import Path

import fmpy.ssp
import pytest
from fmpy.ssp.ssd import read_ssd, read_ssv
from lxml import etree

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from lpfcosim.export import ssp
from lpfcosim.models import model_of, one_axis
from lpfcosim.spacecraft import Authority, Run
from tests import third_party
from tests.campaign_text import campaign

pytestmark = pytest.mark.fmu

SCHEMAS = Path(fmpy.ssp.__file__).parent / "schema"  # of the standard
SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"

COMPONENTS = one_axis.MODEL.components(Run("run", "run", "sysid", 1, Authority("A", 0.0, 1.0, 1.0, 1.0)))


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


def test_fits_the_schema(members):
    for kind, schema, n in (("ssd", "Description", 1), ("ssv", "ParameterValues", 4)):
        schema = etree.XMLSchema(file=str(SCHEMAS / f"SystemStructure{schema}.xsd"))
        checked = [name for name in members if name.endswith(kind)]
        for name in checked:
            schema.assertValid(etree.parse(BytesIO(members[name])))
        assert len(checked) == n


def test_every_connection_is_there_once_and_joins_equal_units(archive, members):
    expected = [
        (*source.split("."), component.model, variable)
        for component in COMPONENTS
        for variable, source in component.inputs.items()
        if "." in source
    ]
    connections = read_ssd(str(archive)).system.connections
    result = [(c.startElement, c.startConnector, c.endElement, c.endConnector) for c in connections]
    assert Counter(result) == Counter(expected)
    units = {
        (element.get("name"), connector.get("name")): connector.find(f"{SSC}Real").get("unit")
        for element in etree.fromstring(members["SystemStructure.ssd"]).iter(f"{SSD}Component")
        for connector in element.iterfind(f"{SSD}Connectors/{SSD}Connector")
    }
    for start, output, end, variable in expected:
        assert units[start, output] == units[end, variable] is not None


def test_every_authority_set_has_its_values(archive, members, plan, fmus):
    known = {
        f"{model}.{v.name}": v.unit
        for model, path in fmus.items()
        for v in fmpy.read_model_description(str(path)).modelVariables
    }
    for name in ("A", "B", "C", "D"):
        run = next(r for r in plan.runs if r.authority.name == name)
        values = read_ssv(str(archive), f"resources/authority_{name}.ssv")
        expected = {f"{m}.{n}": v for m, vs in model_of(run).parameters(run).items() for n, v in vs.items()}
        expected["Plant.g_2"] = run.dc
        assert {p.name: float(p.value) for p in values.parameters} == expected
        assert len(values.parameters) == len(expected)
        for parameter in values.parameters:
            assert parameter.unit == known[parameter.name]
    assert sum(name.endswith(".ssv") for name in members) == 4


def test_bytes_are_reproducible(archive, plan, fmus, tmp_path):
    again = ssp.export(plan, fmus, tmp_path / "again.ssp")
    assert again.read_bytes() == archive.read_bytes()
    assert list(tmp_path.iterdir()) == [again]


def test_fmi_3_is_refused(fmus, tmp_path):
    newer = third_party.built(tmp_path, fmi="3.0")
    file = tmp_path / "own.toml"
    file.write_text(campaign('duration = "60 s"', tables=third_party.TABLE))
    with pytest.raises(InputError, match=r"ThirdParty\.fmu: is FMI 3\.0; SSP 1\.0 takes FMI 2\.0"):
        ssp.export(loading.load(file), {**fmus, "SuspensionControl": newer}, tmp_path / "loop.ssp")
    assert not (tmp_path / "loop.ssp").exists()


def test_values_are_written_with_their_types(fmus, tmp_path):
    third_party.built(tmp_path)
    values = "values = { mode = 2, enabled = false, label = 'half', law = 2 }"
    file = tmp_path / "own.toml"
    file.write_text(campaign('duration = "60 s"', tables=third_party.TABLE + values))
    archives = {**fmus, "SuspensionControl": tmp_path / "ThirdParty.fmu"}
    with zipfile.ZipFile(ssp.export(loading.load(file), archives, tmp_path / "loop.ssp")) as archive:
        name = next(n for n in archive.namelist() if n.endswith(".ssv"))
        root = etree.fromstring(archive.read(name))
    result = {
        parameter.get("name"): (etree.QName(parameter[0]).localname, parameter[0].get("value"))
        for parameter in root.iter(f"{SSV}Parameter")
    }
    for name, value in (
        ("mode", ("Integer", "2")),
        ("enabled", ("Boolean", "false")),
        ("label", ("String", "half")),
        ("law", ("Enumeration", "stiff")),
        ("bandwidth", ("Real", "0.001")),
    ):
        assert result[f"SuspensionControl.{name}"] == value


def test_ecos_follows_a_set_point(archive):
    """Another tool steps the exported loop as it is; that of suspension takes hours to settle."""
    try:
        import ecospy
    except ImportError:
        pytest.skip("ecospy is not installed")
    except OSError as error:
        pytest.skip(f"ecospy does not load: {error}")
    with ecospy.EcosSimulation(0.1, ssp_path=str(archive)) as simulation:
        simulation.init(parameter_set="A")
        simulation.set_real("DragFreeControl::guidance_o_1", 1e-9)
        for _ in range(4000):
            simulation.step()
        assert simulation.get_real("OpticalMetrology::o_1") == pytest.approx(1e-9, rel=1e-3, abs=0)
