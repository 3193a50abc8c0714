"""The exported systems in the hands of others: ecos steps them unchanged, pyssp-standard reads them.

Oracle. The same FMUs stepped by plain FMPy: all at once with what they gave at the last point (Jacobi, as
ecos does), and one after the other (Gauss-Seidel, as `lpfcosim run` does).
"""

import contextlib
import hashlib
import posixpath
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from lxml import etree

from lpfcosim.campaign import loading
from lpfcosim.export import ssp
from lpfcosim.modelica import build
from lpfcosim.models import model_of, one_axis
from lpfcosim.network import endpoint
from tests.lpfcosim.modelica.fmu_instance import fmu_instance

pytestmark = pytest.mark.fmu
NANOMETRE = 1e-9
MODELS = one_axis.MODEL.models


@pytest.fixture(scope="module")
def plan(quickstart):
    return loading.load(quickstart)


@pytest.fixture(scope="module", params=["1.0", "2.0"])
def exported(request, plan, tmp_path_factory):
    fmus = build.build(MODELS, fmi=ssp.fmi(request.param))
    path = tmp_path_factory.mktemp("ssp") / f"loop-{request.param}.ssp"
    ssp.export(plan, fmus, path, request.param)
    return SimpleNamespace(path=path, fmus=fmus, version=request.param)


def by_fmpy(plan, fmus, held, n, *, jacobi):
    """o_1 and o_12 of a loop with constant signals, at the end of every step."""
    run = plan.runs[0]
    signals = {"g_2": run.dc, **held}
    components = model_of(run).components(run)
    values = model_of(run).parameters(run)
    with contextlib.ExitStack() as stack:
        slaves = {
            c.model: stack.enter_context(fmu_instance(fmus[c.model], **values[c.model])) for c in components
        }

        def give(component):
            taken = []
            for source in component.inputs.values():
                model, output = endpoint(source)
                taken.append(slaves[model].get([output])[0] if model else signals.get(source, 0.0))
            return taken

        for _ in range(2):
            for c in components:
                slaves[c.model].set(list(c.inputs), give(c))
        for c in components:
            slaves[c.model].exitInitializationMode()
        out = []
        for k in range(n):
            if jacobi:
                for c, taken in [(c, give(c)) for c in components]:
                    slaves[c.model].set(list(c.inputs), taken)
                for c in components:
                    slaves[c.model].doStep(0.1 * k, 0.1)
            else:
                for c in components:
                    slaves[c.model].set(list(c.inputs), give(c))
                    slaves[c.model].doStep(0.1 * k, 0.1)
            out.append(slaves["OpticalMetrology"].get(["o_1", "o_12"]))
    return np.array(out)


@pytest.fixture(scope="module")
def ecos():
    try:
        import ecospy
    except ImportError:
        pytest.skip("ecospy is not installed")
    except OSError as error:
        pytest.skip(f"ecospy does not load: {error}")
    return ecospy


def by_ecos(ecos, path, held, n):
    out = []
    with ecos.EcosSimulation(0.1, ssp_path=str(path)) as simulation:
        simulation.init(parameter_set="A")
        for name, value in held.items():
            simulation.set_real(f"Signals::{name}_held", value)
        for _ in range(n):
            simulation.step()
            out.append([simulation.get_real(f"OpticalMetrology::{o}") for o in ("o_1", "o_12")])
    return np.array(out)


# What a loop stepped all at once is off by, of the set point, while it settles: a sample more at every
# passage from FMU to FMU. Measured: 0.084 for o_1, whose loop is fast, and 0.001 for o_12.
LATE = {"guidance_o_1": 0.1, "guidance_o_12": 0.002}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "column"), [("guidance_o_1", 0), ("guidance_o_12", 1)])
def test_ecos_follows_a_set_point_as_far_as_stepping_all_at_once_allows(ecos, exported, plan, name, column):
    if exported.version != "1.0":
        pytest.skip("ecos reads SSP 1.0 only")
    found = by_ecos(ecos, exported.path, {name: NANOMETRE}, 4000)[:, column]
    same = by_fmpy(plan, exported.fmus, {name: NANOMETRE}, 4000, jacobi=True)[:, column]
    right = by_fmpy(plan, exported.fmus, {name: NANOMETRE}, 4000, jacobi=False)[:, column]
    np.testing.assert_allclose(found, same, rtol=0, atol=1e-12 * NANOMETRE)
    assert 0 < np.abs(found - right).max() < LATE[name] * NANOMETRE
    if name == "guidance_o_1":  # the other loop takes hours
        np.testing.assert_allclose(found[-1], NANOMETRE, rtol=1e-7)


@pytest.fixture(scope="module")
def pyssp():
    return pytest.importorskip("pyssp_standard.ssp")


def test_pyssp_reads_and_checks_every_file(pyssp, exported, plan):
    ssv = pytest.importorskip("pyssp_standard.ssv")
    with pyssp.SSP(exported.path, mode="r") as archive:
        assert {f.name for f in archive.unpacked_path.glob("*.ssd")} == {"SystemStructure.ssd", "open.ssd"}
        for name in ("SystemStructure", "open"):
            with archive.variants[name] as structure:
                assert structure.version == exported.version
                structure.__check_compliance__()
                components = [e.name for e in structure.system.elements]
                assert set(components) - {"Signals"} == set(MODELS)
                assert ("Signals" in components) == (name == "SystemStructure")
        names = {run.authority.name for run in plan.runs}
        for authority in names:
            with ssv.SSV(archive.ssp_resource_path / f"authority_{authority}.ssv") as values:
                values.__check_compliance__()
                assert {p["name"].partition(".")[0] for p in values.parameters} == {"Signals", *MODELS}


def test_traceability_names_every_file_and_its_digest(exported, plan):
    name = "extra/org.ssp-standard.ssp-traceability.stmd/SimulationTask.stmd"
    with zipfile.ZipFile(exported.path) as stored:
        found = {n: stored.read(n) for n in stored.namelist()}
    root = etree.fromstring(found.pop(name))
    told = {}
    for output in root.iter("{*}Output"):
        for resource in output:
            place = posixpath.normpath(posixpath.join(posixpath.dirname(name), resource.get("source")))
            told[place] = resource.find("{*}Classification/{*}ClassificationEntry").text
    assert told == {n: hashlib.sha256(content).hexdigest() for n, content in found.items()}
    entries = {e.get("keyword"): e.text for e in root[0].iter("{*}ClassificationEntry")}
    assert entries["campaign_sha256"] == plan.digest
    assert "Gauss-Seidel" in root.find("{*}ExecutionPhase/{*}ExecuteSimulation/{*}Procedure").get(
        "description"
    )


def test_fmus_inside_are_of_the_version_that_fits(exported):
    inside = {}
    with zipfile.ZipFile(exported.path) as stored:
        for name in stored.namelist():
            if name.endswith(".fmu"):
                with stored.open(name) as file, zipfile.ZipFile(file) as fmu:
                    inside[Path(name).stem] = etree.fromstring(fmu.read("modelDescription.xml")).get(
                        "fmiVersion"
                    )
    assert inside == dict.fromkeys(["Signals", *MODELS], ssp.fmi(exported.version))
