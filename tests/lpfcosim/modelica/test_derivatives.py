"""Directional derivatives through plain FMPy, against central differences; tunable parameters.

Oracle: differences over eight points about where the FMU stands, whose error falls with the eighth power of
the step. They know the values that an FMU gives back and nothing else.
"""

import math

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from lpfcosim.modelica import build
from tests.lpfcosim.modelica.fmu_instance import fmu_instance, read_description
from tests.lpfcosim.modelica.modelica_source import fmu, write
from tests.lpfcosim.modelica.test_dependencies import ALONG_X, CASES, VERSIONS, anywhere, archive

pytestmark = pytest.mark.fmu

POINTS = np.array([1, 2, 3, 4])
WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
BENT = """model M "Everything that bends"
  parameter Real p(unit = "1") = 2 "Factor"; parameter Real q(unit = "s") = 0.13 "Delay";
  parameter Real z(unit = "1") = 3 "Start of x";
  final parameter Real r(unit = "1") = p^2 + sqrt(p) "Calculated";
  input Real u(unit = "1") "First input"; input Real w(unit = "1") "Second input";
  output Real y(unit = "1") "Smooth"; output Real b(unit = "1") "Bent"; output Real s(unit = "1") "Delayed";
  Real x(start = z*p, fixed = true, unit = "1") "State";
  discrete Real n(start = 0.3, fixed = true, unit = "1") "Sampled";
equation
  der(x) = -r*sin(x)*exp(u) + time;
  y = x*w^2/(1 + u^2) + atan2(w, r) + n*u;
  b = max(u, w) + 2*min(u, p*w) + abs(u - 3*w) + (if u > w then u*w else x);
  s = 3*delay(w, q) + x;
  when sample(0, 0.1) then
    n = pre(n) + u;
  end when;
end M;"""


def differences(instance, unknowns, name, value, width):
    """The derivatives of the unknowns by one variable, and about what they are uncertain by."""

    def at(offset):
        instance.set([name], [value + offset])
        return np.array(instance.get(unknowns))

    steps = width * POINTS
    pairs = [(at(h), at(-h)) for h in steps]
    instance.set([name], [value])
    size = np.max(np.abs(pairs), axis=(0, 1))
    estimate = sum(w * (up - down) for w, (up, down) in zip(WEIGHTS, pairs, strict=True)) / width
    return estimate, size / width


def jacobian(instance, unknowns, knowns):
    columns = [instance.directional(unknowns, [k], [1.0]) for k in knowns]
    return np.array(columns).T


def compare(instance, unknowns, knowns, values):
    exact = jacobian(instance, unknowns, knowns)
    assert np.isfinite(exact).all()
    for column, name in zip(exact.T, knowns, strict=True):
        estimate, scale = differences(instance, unknowns, name, values[name], 0.01 * abs(values[name]))
        # 1e-10 of the derivative, or of 1e-4 of the value per size of what was poked, whichever is more.
        np.testing.assert_array_less(
            np.abs(estimate - column), 1e-10 * np.abs(column) + 1e-14 * scale + 1e-300
        )
    return exact


@pytest.mark.parametrize(("model", "version"), CASES)
def test_derivatives_are_those_of_the_values(model, version):
    path = archive(model, version)
    description = read_description(path)
    values = anywhere(description, np.random.default_rng(2))
    unknowns = list(description.structure.get("InitialUnknown", description.structure["Output"]))
    knowns = [n for n in values if n != "h"]
    running = [*description.structure["Output"], *description.structure.get("ContinuousStateDerivative", {})]
    tunable = description.names(causality=("input",)) + description.names(
        causality=("parameter",), variability=("tunable",)
    )
    with fmu_instance(path, **values) as instance:
        exact = compare(instance, unknowns, knowns, values)
        for row, unknown in zip(exact, unknowns, strict=True):
            dependencies = description.structure.get("InitialUnknown", description.structure["Output"])[
                unknown
            ]
            assert {k for k, d in zip(knowns, row, strict=True) if d} <= set(dependencies)
        instance.exitInitializationMode()
        for n in range(4):
            instance.doStep(n * 0.1, 0.1)
        exact = compare(instance, running, tunable, values)
        assert exact.any() or not set(tunable) & set().union(*description.structure["Output"].values())
        states = description.names(causality=("local", "output"), initial=("exact",))
        assert np.isfinite(jacobian(instance, running, states)).all()


def test_derivative_by_states_is_that_of_initialization():
    # After a step a state cannot be set. Where nothing is delayed or starts anew, the equations are the same.
    path = archive("Plant", "3.0")
    description = read_description(path)
    states = description.names(initial=("exact",), causality=("local",))
    with fmu_instance(path) as instance:
        at_start = jacobian(instance, ["x_1", "x_2", "a_SC", "der(testMass_1.v)"], states)
        instance.exitInitializationMode()
        instance.doStep(0.0, 0.1)
        after_step = jacobian(instance, ["x_1", "x_2", "a_SC", "der(testMass_1.v)"], states)
    np.testing.assert_array_equal(at_start, after_step)
    assert at_start[0].tolist() == [float(s == "testMass_1.x") for s in states]


@pytest.fixture(scope="module", params=VERSIONS)
def kinked(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bent")
    build.build_one(write(folder, BENT), "M", folder / "M.fmu", fmi=request.param)
    return folder / "M.fmu"


def test_what_bends_has_the_slope_of_its_side(kinked):
    for u, w in ((1.2, 0.7), (0.7, 1.5), (-0.9, 2.0)):
        values = {"u": u, "w": w, "p": 2.2, "n": 0.4, "z": 1.3}
        with fmu_instance(kinked, **values) as instance:
            exact = compare(instance, ["y", "b", "s", "x", "der(x)", "r"], list(values), values)
            assert exact[3].tolist() == [0, 0, 1.3, 0, 2.2]  # the start of x
            assert exact[2, 1] == 3  # at the start a delay hands on what is set
            instance.exitInitializationMode()
            instance.doStep(0.0, 0.1)
            exact = compare(instance, ["y", "b", "s", "der(x)"], ["u", "w", "p"], values)
            assert exact[2].tolist() == [0, 0, 0]  # and later not


def test_time_is_a_known(kinked):
    description = read_description(kinked)
    if description.version.startswith("3"):
        assert "time" in description.structure["ContinuousStateDerivative"]["der(x)"]
        with fmu_instance(kinked) as instance:
            assert instance.directional(["der(x)", "y"], ["time"], [2.0]) == [2.0, 0.0]


def test_what_follows_from_others_is_no_known(kinked):
    description = read_description(kinked)
    with fmu_instance(kinked) as instance:
        for known in ("y", "r", "x"):  # x starts where z says
            with pytest.raises(FMICallException):
                instance.directional(["b"], [known], [1.0])
        with pytest.raises(FMICallException):
            instance.getDirectionalDerivative([99], description.vr(["u"]), [1.0])


def test_asking_for_a_derivative_changes_nothing(kinked):
    def run(asking):
        with fmu_instance(kinked, u=0.2) as instance:
            instance.exitInitializationMode()
            for n in range(5):
                instance.set(["w"], [math.sin(n)])
                if asking:
                    jacobian(instance, ["y", "der(x)"], ["u", "w", "x"])
                instance.doStep(n * 0.1, 0.1)
            return instance.get(["y", "b", "s", "x", "n"])

    assert run(True) == run(False)


def test_tuned_parameter_acts_from_the_next_step_on(tmp_path):
    text = """model M
      parameter Real k(unit = "s-1") = 1 "Rate"; final parameter Real r(unit = "s-1") = 2*k "Twice";
      parameter Real h(unit = "s") = 0.1 "Sampling"; parameter Real z(unit = "1") = 1 "Start";
      output Real x(start = z, fixed = true, unit = "1") "Falls";
      discrete output Real n(start = 0, fixed = true);
    equation
      der(x) = -r*x; when sample(0, h) then n = pre(n) + 1; end when;
    end M;"""
    path = fmu(tmp_path, text)
    description = read_description(path)
    assert description.names(variability=("tunable",)) == ["k", "r"]
    with fmu_instance(path) as instance:
        instance.exitInitializationMode()
        for n, k in enumerate((1, 1, 3, 3, 0.5)):
            instance.set(["k"], [k])
            instance.doStep(n * 0.2, 0.2)
        assert instance.get(["x"])[0] == pytest.approx(math.exp(-2 * 0.2 * (1 + 1 + 3 + 3 + 0.5)), rel=1e-14)
        assert instance.get(["r", "n"]) == [1.0, 10.0]
        for fixed in ("h", "z"):
            with pytest.raises(FMICallException):
                instance.set([fixed], [0.2])


def test_tuning_to_the_same_value_changes_no_bit():
    path = archive("Plant", "3.0")

    def run(tuning):
        with fmu_instance(path) as instance:
            instance.exitInitializationMode()
            for n in range(40):
                instance.set(["F_x_sc", "f_applied_2"], [1e-7 * math.sin(n), 1e-12 * math.cos(n)])
                if tuning:
                    instance.set(["omega2_2_0"], [-4.19e-7])
                instance.doStep(n * 0.1, 0.1)
            return instance.get(["x_1", "x_2", "a_SC"])

    assert run(True) == run(False)


def test_tuning_that_makes_the_model_singular_is_an_error_that_can_be_mended():
    with fmu_instance(archive("Plant", "3.0"), F_noise_x_sc=1e-9) as instance:
        instance.exitInitializationMode()
        instance.doStep(0.0, 0.1)
        instance.set(["m_sc"], [0.0])
        with pytest.raises(FMICallException):
            instance.doStep(0.1, 0.1)
        instance.set(["m_sc"], [422.7])
        instance.doStep(0.1, 0.1)
        assert math.isfinite(instance.get(["x_1"])[0])


def test_what_places_clocks_delays_and_starts_stays_as_it_was():
    fixed = {
        model: set(
            read_description(archive(model, "3.0")).names(causality=("parameter",), variability=("fixed",))
        )
        for model in ALONG_X
    }
    assert fixed == {
        "Plant": {"tau_1", "tau_2", "tau_sc", "F_x_sc_start"},
        "Actuation": {"h", "f_x_2_start"},
        "OpticalMetrology": set(),
        "DragFreeControl": {"h"},
        "SuspensionControl": {"h"},
    }
