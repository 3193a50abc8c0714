"""Another Modelica package beside LISAPathfinder: it may use that one, and its FMUs are named after it."""

import fmpy
import pytest

from lpfcosim.modelica import build, numpy_models
from lpfcosim.modelica.sources import used_libraries

pytestmark = pytest.mark.fmu

PACKAGE = """package Probe "A body that thrusters push"
  annotation (uses(LISAPathfinder(version = "1")));
end Probe;
"""
BODY = """within Probe;
model Body "A body that thrusters push"
  parameter LISAPathfinder.Types.Mass m = 2 "Mass";
  LISAPathfinder.Interfaces.ThrustInput F "Thrust";
  LISAPathfinder.Interfaces.PositionOutput x(start = 0, fixed = true) "Position";
  LISAPathfinder.Types.Velocity v(start = 0, fixed = true) "Velocity";
equation
  der(x) = v;
  m*der(v) = F;
end Body;
"""


@pytest.fixture
def library(tmp_path, monkeypatch):
    """Folder of LISAPathfinder, a link, and of the package Probe beside it."""
    monkeypatch.setenv("LPFCOSIM_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "fmus" / "Probe"
    folder.mkdir(parents=True)
    (folder / "package.mo").write_text(PACKAGE)
    (folder / "Body.mo").write_text(BODY)
    link = folder.parent / "LISAPathfinder"
    link.symlink_to(build.PACKAGE, target_is_directory=True)
    return link


def test_package_uses_another_one(library):
    assert used_libraries(library) == []
    assert used_libraries(library.parent / "Probe") == [library]
    assert build.package_of("Plant", library) == library
    assert build.class_name("ProbeBody", library) == "Probe.Body"
    assert build.class_name("Plant", library) == "LISAPathfinder.OneAxis.Plant"


def test_fmu_of_another_package(library):
    built = build.build(["ProbeBody"], library)["ProbeBody"]
    description = fmpy.read_model_description(str(built))
    assert description.coSimulation.modelIdentifier == "ProbeBody"
    moved = fmpy.simulate_fmu(str(built), stop_time=1, output_interval=0.1, start_values={"F": 1e-6})["x"][-1]
    assert moved == pytest.approx(0.25e-6, rel=1e-12)


def test_python_module_of_another_package(library, monkeypatch):
    monkeypatch.setattr(build, "package_of", lambda model: library.parent / model.removesuffix("Body"))
    monkeypatch.setattr(build, "class_name", lambda _: "Probe.Body")
    numpy_models.write("ProbeBody", library.parent / "ProbeBody.py")
    text = (library.parent / "ProbeBody.py").read_text()
    assert "INPUTS = {'F': (0.0, 'N')}" in text
    assert "'x': 'Position'" in text
