"""The Modelica library: its test models hold, and its examples are the loops of the co-simulation."""

import re

import fmpy
import numpy as np
import pytest

from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Sine
from tests.lpfcosim.cosim import in_memory

pytestmark = pytest.mark.fmu

TESTS = sorted(p.stem for p in (build.PACKAGE / "Test").glob("*.mo") if p.stem != "package")
#: Component of an example by FMU; those of six degrees of freedom and of LISA have the same names.
COMPONENTS = {
    "OpticalMetrology": "interferometer", "DragFreeControl": "dragFree", "SuspensionControl": "suspension",
    "Actuation": "actuation", "Plant": "plant", "Metrology": "interferometer", "StarTracker": "starTracker",
    "InertialSensor": "inertialSensor", "AttitudeControl": "attitude", "LISAMetrology": "metrology",
    "PointingControl": "pointing",
}  # fmt: skip
WHOLE = {
    "delta_phi": -0.47e-3, "leak_phi_1": 0.01,
    "b_1": 1.2e-5, "b_2": -0.9e-5, "b_3": 2.2e-5, "b_4": -1.8e-5, "b_5": 1e-7, "b_6": -1e-7,
    "omega2_eta_0": -1.5e-6, "omega2_phi_0": -1.5e-6,
}  # fmt: skip
LOOPS = [  # the example, its spacecraft, what is driven
    pytest.param("Examples.OneAxisClosedLoop", "lpf-x", "guidance_o_12"),
    pytest.param("Examples.SixDofClosedLoop", "lpf", "guidance_o_12", marks=pytest.mark.slow),
    pytest.param("LISAExamples.ClosedLoop", "lisa", "guidance_o_1", marks=pytest.mark.slow),
    pytest.param("LISAExamples.ClosedLoop", "lisa-fall-back", "guidance_o_1", marks=pytest.mark.slow),
]


def component(model):
    return COMPONENTS.get(model) or COMPONENTS[model.removeprefix("Whole").removeprefix("LISA")]


@pytest.mark.parametrize("name", TESTS)
def test_assertions_of_a_test_model_hold(name):
    text = (build.PACKAGE / "Test" / f"{name}.mo").read_text(encoding="utf-8")
    stop = float(re.search(r"StopTime = (\d+)", text)[1])
    archive = build.build([f"Test.{name}"])[f"Test.{name}"]
    assert len(fmpy.simulate_fmu(str(archive), stop_time=stop, output_interval=0.1)) == round(stop / 0.1) + 1


@pytest.mark.parametrize(("example", "spacecraft", "driven"), LOOPS)
def test_example_steps_like_the_co_simulation(make_run, example, spacecraft, driven):
    sine = Sine(driven, amplitude=10e-9, frequency=0.01, cycles=100, start=0)
    dc = 0.0 if "LISA" in example else 3e-12
    run = make_run(spacecraft=spacecraft, injections=(sine,), dc=dc, n_samples=1500)
    spacecraft_model = model_of(run)
    expected = in_memory.simulate(run, build.build(spacecraft_model.models))
    sources = {name: source.partition(".") for name, source in spacecraft_model.record.items()}
    channels = {n: f"{component(model)}.{output}" for n, (model, dot, output) in sources.items() if dot}
    parameters = spacecraft_model.parameters(run)
    start = {f"{component(m)}.{p}": v for m, values in parameters.items() for p, v in values.items()}
    start |= {"guidance.amplitude": 10e-9, "guidance.f": 0.01} | ({"signals.g_2_held": dc} if dc else {})
    result = fmpy.simulate_fmu(
        str(build.build([example])[example]), stop_time=run.n_samples * run.h, output_interval=run.h,
        start_values=start, output=list(channels.values()),
    )  # fmt: skip
    for name, variable in channels.items():
        # A command that follows from the read-outs at t_n is seen at the end of the step from t_n.
        commanded = variable.partition(".")[0] in ("actuation", "dragFree", "pointing")
        values = result[variable][1:] if commanded else result[variable][:-1]
        tolerance = 1e-9 * np.sqrt(np.mean(expected[name] ** 2)) + 1e-28  # rounding, where nothing moves
        np.testing.assert_allclose(values, expected[name], rtol=0, atol=tolerance, err_msg=name)
