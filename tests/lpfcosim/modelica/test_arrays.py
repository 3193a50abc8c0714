"""Arrays of a Modelica model: one variable of FMI 3.0, scalars in FMI 2.0, and the same numbers in both.

Oracle. The FMU of FMI 2.0, that has no arrays; sums by NumPy.
"""

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

from lpfcosim.modelica import build
from tests.lpfcosim.modelica.fmu_instance import Description, fmu_instance
from tests.lpfcosim.modelica.modelica_source import write

pytestmark = pytest.mark.fmu
MODEL = """model M "Arrays"
  parameter Real p[3](each unit = "s-1", min = {0, -1, -2}, max = {5, 6, 7}) = {1, 2, 3} "Rates";
  parameter Real A[2,3](nominal = {{1, 2, 3}, {4, 5, 6}}) = {{1, 2, 3}, {4, 5, 6}} "Matrix";
  parameter Real z = 4 "Start"; parameter Real one[1] = {7} "Array of one";
  final parameter Real q[3] = 2*p "Calculated";
  input Real u[3](each unit = "1") "Inputs";
  output Real y[2] "Outputs"; output Real s "Scalar";
  Real x[3](start = {0.5, z, 0.7}, each fixed = true, each unit = "1") "States";
  discrete Real n[2](each start = 0.25, each fixed = true) "Sampled";
equation
  for i in 1:3 loop
    der(x[i]) = -p[i]*x[i] + u[i];
  end for;
  y = A*x + n;
  s = x[1]*x[2] + q[3] + one[1];
  when sample(0, 0.1) then
    n = pre(n) + u[1:2];
  end when;
end M;"""
A = np.array([[1, 2, 3], [4, 5, 6]])


@pytest.fixture(scope="module")
def array_fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arrays")
    source = write(folder, MODEL)
    for version in ("2.0", "3.0"):
        build.build_one(source, "M", folder / f"{version}.fmu", fmi=version)
    return {version: folder / f"{version}.fmu" for version in ("2.0", "3.0")}


def test_arrays_are_declared_with_their_extents(array_fmus):
    assert validate_fmu(str(array_fmus["3.0"])) == []
    result = {v.name: v for v in fmpy.read_model_description(str(array_fmus["3.0"])).modelVariables}
    shapes = {name: v.shape for name, v in result.items() if v.shape}
    assert shapes == {
        "p": (3,), "A": (2, 3), "one": (1,), "q": (3,), "u": (3,), "y": (2,), "x": (3,), "n": (2,),
        "der(x)": (3,),
    }  # fmt: skip
    assert result["A"].start == "1.0 2.0 3.0 4.0 5.0 6.0"
    # What is said for all holds for each.
    assert (result["p"].min, result["p"].max, result["A"].nominal) == ("-2.0", "7.0", "1.0")
    assert (result["p"].variability, result["q"].variability) == ("tunable", "tunable")
    assert result["x"].initial == "calculated"  # one element starts where a parameter says
    assert result["der(x)"].derivative is result["x"]
    assert len({v.valueReference for v in result.values()}) == len(result)


def test_an_array_depends_on_what_any_element_does(array_fmus):
    structure = Description(array_fmus["3.0"]).structure
    assert set(structure["Output"]["y"]) == {"x", "A", "n"}
    assert structure["Output"]["y"]["n"] == "constant"
    assert structure["ContinuousStateDerivative"]["der(x)"]["u"] == "constant"
    assert "z" in structure["InitialUnknown"]["x"]


def test_fmpy_steps_whole_arrays_to_the_numbers_of_scalars(array_fmus):
    time = np.arange(21) * 0.1
    waves = np.array([np.sin(time), np.cos(2 * time), time**2]).T
    whole = np.zeros(21, [("time", float), ("u", float, (3,))])
    whole["time"], whole["u"] = time, waves
    single = np.zeros(21, [("time", float), *((f"u[{k}]", float) for k in (1, 2, 3))])
    single["time"] = time
    for k in range(3):
        single[f"u[{k + 1}]"] = waves[:, k]
    options = {"stop_time": 2.0, "step_size": 0.1, "output_interval": 0.1}
    arrays = fmpy.simulate_fmu(
        str(array_fmus["3.0"]),
        input=whole,
        output=["y", "s", "x", "n"],
        start_values={"p": [2, 1, 0.5]},
        **options,
    )
    scalars = fmpy.simulate_fmu(
        str(array_fmus["2.0"]), input=single, start_values={"p[1]": 2, "p[2]": 1, "p[3]": 0.5},
        output=["y[1]", "y[2]", "s", *(f"x[{k}]" for k in (1, 2, 3)), "n[1]", "n[2]"], **options,
    )  # fmt: skip
    np.testing.assert_array_equal(arrays["s"], scalars["s"])
    for name in ("y", "x", "n"):
        for k in range(arrays[name].shape[1]):
            np.testing.assert_array_equal(arrays[name][:, k], scalars[f"{name}[{k + 1}]"])
    np.testing.assert_allclose(arrays["y"], arrays["x"] @ A.T + arrays["n"], rtol=1e-14)
    assert np.ptp(arrays["y"]) > 1


def test_whole_arrays_are_set_and_read_in_any_company(array_fmus):
    vr = {n: v.valueReference for n, v in Description(array_fmus["3.0"]).variables.items()}
    s = vr["s"]
    with fmu_instance(array_fmus["3.0"]) as fmu:
        fmu.setFloat64([vr["u"], vr["one"], vr["n"]], [1, 2, 3, 8, 0.1, 0.2])
        assert fmu.getFloat64([s, vr["u"], vr["one"], vr["n"]], 7)[1:] == [1, 2, 3, 8, 0.1, 0.2]
        np.testing.assert_allclose(
            fmu.getFloat64([vr["y"], s], 3), [*(A @ [0.5, 4, 0.7] + [0.1, 0.2]), 2 + 6 + 8], rtol=1e-15
        )
        for wrong in (1, 2, 4, 0):
            with pytest.raises(FMICallException):
                fmu.getFloat64([vr["u"]], wrong)
            with pytest.raises(FMICallException):
                fmu.setFloat64([vr["u"]], [9.0] * wrong)
        with pytest.raises(FMICallException):
            fmu.getFloat64([vr["u"], s], 2)
        with pytest.raises(FMICallException):
            fmu.getFloat64([max(vr.values()) + 1], 1)
        assert fmu.getFloat64([vr["u"]], 3) == [1, 2, 3]
        fmu.exitInitializationMode()
        fmu.setFloat64([vr["p"]], [3, 2, 1])  # tunable
        with pytest.raises(FMICallException):
            fmu.setFloat64([vr["y"]], [3, 2])
